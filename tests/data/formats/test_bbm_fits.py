"""Published fits: what a file of them says, every material of the collection, and files that are none."""

import numpy as np
import pytest

from gonio.data.formats.bbm_fits import published_expression, published_names
from gonio.data.formats.registry import read
from gonio.data.subject import load_material
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import from_spherical
from support import helpers

FIT = """# a comment
nickel = Aggregate(Lambertian(albedo = [0.02, 0.01, 0.01]), NganWard(albedo = [0.074, 0.0538, 0.0276], roughness = 0.1))
chalk = Lambertian(albedo = 0.8)
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "ward.fit"
    path.write_text(FIT)
    return path


def test_a_fit_is_a_material(file):
    assert published_names(file) == ["nickel", "chalk"]
    material = load_material(f"{file}:nickel")
    assert material.name == "nickel" and len(material.channels) == 3
    assert published_expression(file, "chalk") == "lambert(rho=0.8)"
    wi, wo = from_spherical(0.5, 0.0), from_spherical(0.6, 3.0)
    direct = build("lambert(rho=[0.02, 0.01, 0.01]) + [0.074, 0.0538, 0.0276] * ward(alpha=0.1)")
    assert np.array_equal(evaluate(material.brdf, wi, wo), evaluate(direct, wi, wo))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("x = Aggregate(Lambertian(albedo = 0.5), NganWard(roughness = 0.1))", "no albedo"),
        ("x = NganWart(albedo = 0.5)", "unknown model"),
        ("x = Lambertian(albedo = __import__)", "a number expected"),
        ("x = Lambertian(albedo = [[[1]]])", "lists of lists of lists"),
        ("x = Lambertian(albedo = 0.5) Lambertian", "this is no Model"),
        ("x = Lambertian(albedo = {0.5})", "a number expected"),
        ("x = Lambertian(albedo = 1e999)", "a number expected"),
        ("x = " + 5000 * "Aggregate(" + 5000 * ")", "this is no Model"),
        ("x = NganWard(albedo = 0.5, roughness = -1)", "outside of its domain"),
        ("hello", "expected 'name = Model(...)'"),
        ("", "empty|no fits"),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path, line, said):
    path = tmp_path / "bad.fit"
    path.write_text(line)
    with pytest.raises(
        GonioError, match=said.replace("(", r"\(").replace(")", r"\)").replace("...", r"\.\.\.")
    ) as error:
        load_material(f"{path}:x")
    assert "\n" not in str(error.value)


def test_names_that_are_not_there(file):
    with pytest.raises(GonioError, match="nickel"):
        load_material(f"{file}:nikel")


def test_a_file_of_them_is_no_material_and_a_fit_no_table(file):
    with pytest.raises(GonioError, match=r"name one of them, as in '.*ward.fit:nickel'"):
        load_material(file)
    with pytest.raises(GonioError, match="is a model, not a table; measure it first"):
        read(f"{file}:nickel")


def test_a_long_list_of_names_is_cut(tmp_path):
    path = tmp_path / "many.fit"
    path.write_text("\n".join(f"m{k} = Lambertian(albedo = 0.5)" for k in range(80)))
    with pytest.raises(GonioError, match="m41, and 38 more"):
        load_material(f"{path}:zzz")


@pytest.mark.thorough
def test_every_published_fit_is_read_and_finite():
    """All 1,302 entries of the collection; one in five at pairs of every kind."""
    folder = helpers.shared("data", "published_fits")
    d = np.load(helpers.shared("oracle", "models_double.npz"))
    some = np.concatenate([np.flatnonzero(d["tag"] == t)[:7] for t in np.unique(d["tag"])])
    wi, wo = (type(from_spherical(0.1, 0.0))(*d[k][some].T) for k in ("wi", "wo"))
    read = 0
    for path in sorted(folder.glob("*.fit")):
        for name in published_names(path):
            brdf = build(published_expression(path, name))
            if read % 5 == 0:  # the others differ by their numbers
                assert np.isfinite(np.asarray(evaluate(brdf, wi, wo))).all(), (path.name, name)
            read += 1
    assert read == 1302


def test_a_scale_that_is_a_list_of_lists_is_refused(tmp_path):
    path = tmp_path / "odd.fit"
    path.write_text("a = NganWard(albedo = [[1]], roughness = 0.1)")
    with pytest.raises(GonioError, match="a number or a list of them"):
        published_expression(path, "a")
