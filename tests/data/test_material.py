"""Materials: the reference set keeps its promises, files are read strictly and written back, names are found."""

import copy
import pickle
import re
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.formats.material_file import LARGEST, write_material
from gonio.data.hdf5.writer import write_table
from gonio.data.material import Material
from gonio.data.subject import REFERENCE_FOLDER, load_material, reference_materials
from gonio.data.table import Channels, Table
from gonio.models.albedo import directional_albedo
from gonio.models.brdf import Scaled, terms
from gonio.models.errors import GonioError
from gonio.models.evaluation import channel_count, evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import from_spherical
from support.marks import thorough

LIARS = {"white_gloss_sum"}
WI = from_spherical(jnp.asarray([0.1, 0.5, 1.2]), jnp.asarray([0.0, 1.0, 2.0]))
WO = from_spherical(jnp.asarray([0.2, 0.6, 1.3]), jnp.asarray([3.0, 4.5, 0.5]))


def test_there_are_enough_and_every_one_is_complete():
    names = reference_materials()
    assert len(names) >= 18
    for name in names:
        found = load_material(name)
        assert found.name == name
        assert len(found.description) > 20 and len(found.source) > 10
        assert len(found.channels) == (channel_count(found.brdf) or 1)


def test_the_reference_set_spans_what_it_should():
    spelled = " ".join(load_material(name).expression for name in reference_materials())
    for needed in ("lambert", "eon", "fujii", "phong", "ggx", "beckmann", "white_standard", "alpha_x", "alpha=0.002"):
        assert needed in spelled


TOLERANCE = 1e-5
"""Of the albedo of a term."""


@pytest.mark.parametrize("part", [4, *thorough(1)], ids=["one in four", "every one"])
def test_every_material_but_the_liars_conserves_energy(part):
    theta = np.radians([0.0, 60.0, 85.0, 89.0, 89.9])
    for name in [*LIARS, *list(reference_materials())[::part]]:
        # Term by term: terms of one kind share a compiled program.
        total = bound = 0.0
        parts = terms(load_material(name).brdf)
        for term in parts:
            scale, base = (np.asarray(term.scale), term.base) if isinstance(term, Scaled) else (1.0, term)
            e = directional_albedo(base, theta, 0.3, tolerance=TOLERANCE)
            value, margin = (a[:, None] if a.ndim == 1 else a for a in e[:2])
            total, bound = total + scale * value, bound + scale * margin
        assert np.max(bound) <= len(parts) * TOLERANCE
        assert (np.max(total) > 1.01) if name in LIARS else (np.max(total - bound) <= 1 + 1e-9), name


@pytest.mark.parametrize(
    ("name", "wavelength", "eta", "k"),
    [  # Johnson & Christy 1972 and 1974, Rakić 1995
        ("gold", 548.6, 0.43, 2.455),
        ("gold", 659.5, 0.14, 3.697),
        ("silver", 548.6, 0.06, 3.586),
        ("copper", 659.5, 0.22, 3.747),
        ("aluminium", 563.57, 1.0728, 6.7839),
        ("aluminium_brushed", 563.57, 1.0728, 6.7839),
        ("chromium", 549.0, 3.18, 3.33),
        ("titanium_blasted", 549.0, 2.54, 3.43),
    ],
)
def test_metals_have_the_published_constants(name, wavelength, eta, k):
    found = load_material(name)
    at = found.channels.wavelengths_nm.index(wavelength)
    assert (float(found.brdf.eta[at]), float(found.brdf.k[at])) == (eta, k)


def test_a_spelling_is_a_material():
    text = "lambert(rho=[0.1, 0.2, 0.3]) + 0.5 * ggx(alpha=0.2, f0=0.04)"
    found = load_material(text)
    assert found.expression == text
    assert found.channels == Channels.rgb()
    assert np.array_equal(evaluate(found.brdf, WI, WO), evaluate(build(text), WI, WO))


def test_a_table_file_is_a_material(tmp_path):
    theta, phi = np.radians([0.0, 20.0, 40.0, 60.0, 80.0]), np.radians([0.0, 90.0, 180.0, 270.0])
    grid = layouts.isotropic(theta, theta, phi)
    rho = np.array([0.2, 0.4])
    f = np.broadcast_to(rho / np.pi, (*grid.shape, 2))
    table = Table(grid, f, np.zeros(f.shape, np.uint8), Channels.of_wavelengths([500.0, 600.0]), name="flat")
    write_table(tmp_path / "flat.h5", table)
    found = load_material(tmp_path / "flat.h5")
    assert found.channels == table.channels
    assert found.expression is None
    np.testing.assert_allclose(evaluate(found.brdf, WI, WO), np.broadcast_to(rho / np.pi, (3, 2)), rtol=1e-14)
    with pytest.raises(GonioError, match="no expression"):
        write_material(tmp_path / "flat.toml", found)
    (tmp_path / "noise.bin").write_bytes(b"\x01\x02" * 100)
    with pytest.raises(GonioError, match="noise"):
        load_material(tmp_path / "noise.bin")


def test_written_and_read_back_it_is_the_same(tmp_path):
    path = tmp_path / "fitted.toml"
    model = build("lambert(rho=[0.1, 0.2]) + 0.3 * ggx(alpha=0.123456789012345678, eta=1.5)")
    fit = {"ok": True, "rms": np.float64(1e-3), "values": np.arange(3), "nothing": None, "deep": {"seed": 3}}
    out = Material("m", model, None, Channels.of_wavelengths([450.0, 633.5]), 'a "quoted" one', "me", {"fit": fit})
    write_material(path, out)
    back = load_material(path)
    assert np.array_equal(evaluate(back.brdf, WI, WO), evaluate(model, WI, WO))
    assert (back.name, back.description, back.source) == (out.name, out.description, out.source)
    assert back.channels == out.channels
    assert back.meta["fit"] == {"ok": True, "rms": 1e-3, "values": [0, 1, 2], "deep": {"seed": 3}}
    with pytest.raises(GonioError, match="exists"):
        write_material(path, out)
    write_material(path, back, force=True)
    assert load_material(str(path)).expression == back.expression


def test_what_has_no_spelling_leaves_no_file(tmp_path):
    class Odd(type(build("lambert(rho=0.5)"))):
        pass

    with pytest.raises(GonioError, match="no expression"):
        write_material(tmp_path / "odd.toml", Material("odd", Odd(0.5), None, Channels.grey()))
    assert list(tmp_path.iterdir()) == []


GOOD = 'gonio_material = 1\nmodel = "lambert(rho=[0.1, 0.2, 0.3])"\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("\x00\x01", "TOML"),
        ("gonio_material = ", "TOML"),
        ('model = "lambert(rho=1)"\n', "gonio_material"),
        ('gonio_material = true\nmodel = "lambert(rho=1)"\n', "gonio_material"),
        ('gonio_material = 2\nmodel = "lambert(rho=1)"\n', "format 2"),
        ("gonio_material = 1\n", "no model"),
        ("gonio_material = 1\nmodel = 3\n", "model is int"),
        ('gonio_material = 1\nmodel = "lambrt(rho=1)"\n', "lambert"),
        ('gonio_material = 1\nmodel = "lambert(rho=1.5)"\n', "domain"),
        ('gonio_material = 1\nmodel = "ggx()"\n', "alpha"),
        (GOOD + 'colour = "red"\n', "unknown key 'colour'"),
        (GOOD + 'channels = ["R", "G"]\n', "2 channels"),
        (GOOD + "channels = [1, 2, 3]\n", "not a name"),
        (GOOD + 'channels = "RGB"\n', "channels is str"),
        (GOOD + "wavelengths_nm = [400, 500, -1]\n", "wavelengths"),
        (GOOD + "wavelengths_nm = [400, 500, nan]\n", "wavelengths"),
        (GOOD + "wavelengths_nm = []\n", "empty"),
        (GOOD + 'channels = ["a", "b", "c"]\nwavelengths_nm = [1, 2, 3]\n', "both"),
        (GOOD + 'source = "me"\n', "source is str"),
        (GOOD + "name = 3\n", "name is int"),
        (GOOD + "fit = 3\n", "fit is int"),
        (GOOD + "deep = " + "[" * 5000 + "\n", "TOML"),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path, text, said):
    path = tmp_path / "bad.toml"
    path.write_text(text, newline="")
    with pytest.raises(GonioError, match=re.escape(said)) as caught:
        load_material(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_material_file_is_known_by_its_content_too(tmp_path):
    path = tmp_path / "material.txt"
    path.write_text(GOOD)
    assert load_material(path).channels == Channels.rgb()


def test_a_huge_file_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "huge.toml"
    with path.open("wb") as file:
        file.truncate(LARGEST + 1)
    with pytest.raises(GonioError, match="at most"):
        load_material(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("golt", "did you mean 'gold'"),
        ("zzzzzz", "known are"),
        ("ggx", "its parameters"),
        ("no/such/file.h5", "does not exist"),
        ("missing.toml", "does not exist"),
        ("lamber(rho=1)", "did you mean 'lambert'"),
        ("lambert(rho=1) + \x00", "character"),
        ("a" * 5000, "Unknown material"),
    ],
)
def test_unknown_names_are_said_with_the_nearest(text, said):
    with pytest.raises(GonioError, match=re.escape(said)):
        load_material(text)
    with pytest.raises(GonioError) as caught:
        load_material(text)
    assert len(str(caught.value)) < 900


def test_reference_files_are_plain_toml_without_surprises():
    for name in reference_materials():
        data = tomllib.loads((REFERENCE_FOLDER / f"{name}.toml").read_text())
        assert data["gonio_material"] == 1
        assert data["source"]["text"]


def test_copies_of_a_material_are_one_key():
    material = load_material("lambert(rho=[0.1, 0.2]) + ggx(alpha=0.2)")
    assert {material: 1}[copy.deepcopy(material)] == {material: 1}[pickle.loads(pickle.dumps(material))] == 1


def test_a_traced_angle_is_told_how_to_trace():
    material = load_material("lambert(rho=0.2)")
    with pytest.raises(GonioError, match="traced by JAX"):
        jax.grad(lambda theta: material.f(theta, 0.0, 0.4, 3.0)[0])(0.3)
