"""The result of a fit as a subject: saved, read, measured and checked again."""

import tomllib

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.data.hdf5.writer import write_table
from gonio.models.errors import GonioError
from support.fit_tables import COARSE_ISOTROPIC, ONE_LOBE, table_of

MODEL = "lambert + ggx(f0=0.04)"


@pytest.fixture(scope="module")
def table():
    return table_of(ONE_LOBE, COARSE_ISOTROPIC, noise=0.02, name="mine")


@pytest.fixture(scope="module")
def result(table):
    return gonio.fit(table, MODEL, starts=0)


def test_it_is_saved_as_the_command_line_writes_it(table, result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_table("t.h5", table)
    assert main(["fit", "t.h5", "-m", MODEL, "--starts", "0", "-o", "line.fit.toml"]) == 0
    result.save("face.fit.toml")
    line, face = (tomllib.loads((tmp_path / f"{name}.fit.toml").read_text()) for name in ("line", "face"))
    assert (line.pop("name"), face.pop("name")) == ("line", "face")
    fits = [content.pop("fit") for content in (line, face)]
    assert line == face
    for key in fits[0].keys() - {"seconds"}:
        assert repr(fits[0][key]) == repr(fits[1][key]), key  # maps have cells without a reading, NaN


def test_a_saved_fit_is_not_replaced_unasked(result, tmp_path):
    path = result.save(tmp_path / "a.fit.toml")
    with pytest.raises(GonioError, match="exists"):
        result.save(path)
    assert result.save(path, force=True) == path
    again = gonio.material(path)
    assert again.expression == result.expression and again.meta["fit"]["converged"] is True


def test_its_material_is_a_subject(result):
    material = result.material
    assert material.expression == result.expression and material.channels == result.channels
    assert material.meta["fit"]["cost"] == result.cost and material.name == "fit of mine"
    measured = gonio.measure(result, scan=COARSE_ISOTROPIC)
    assert np.nanmax(np.asarray(measured.f)) > 0
    assert gonio.check(result).overall == gonio.check(material).overall == "pass"


def test_an_albedo_has_both_of_its_errors(result):
    """Of a Lambertian the directional albedo is ρ, and its uncertainty is that of ρ; with a lobe it is not."""
    bare = gonio.fit(table_of("lambert(rho=[.1,.2,.4])", COARSE_ISOTROPIC, noise=0.02), "lambert")
    albedo = bare.albedo(np.array([10.0, 60.0]), degrees=True)
    rho = np.array([p.value for p in bare.parameters])
    u = np.array([p.standard_uncertainty for p in bare.parameters])
    np.testing.assert_allclose(albedo.value, [rho, rho], rtol=1e-6)
    np.testing.assert_allclose(albedo.standard_uncertainty, [u, u], rtol=1e-6)
    assert np.all(albedo.numerical_error < 1e-5)
    lobe = result.albedo(0.5)
    assert np.all(lobe.standard_uncertainty > 0) and np.all(lobe.numerical_error < lobe.standard_uncertainty)


def test_a_linear_quantity_propagates_as_the_covariance_says(result):
    """f is linear in ρ and scale: u² of f at one pair of directions is g C gᵀ with the gradient of the material."""
    pair = (0.4, 0.0, 0.5, np.pi)
    gradient = result.material.gradient(*pair)
    rows = np.zeros((3, len(result.free_names)))
    for c, name in enumerate("RGB"):
        for k, label in enumerate(result.free_names):
            path, _, channel = label.partition("[")
            if channel.rstrip("]") in ("", name):
                rows[c, k] = gradient[path][..., c]
    expected = np.sqrt(np.einsum("ci,ij,cj->c", rows, result.covariance, rows))
    np.testing.assert_allclose(result.propagated(lambda m: m.f(*pair)), expected, rtol=1e-3)
    np.testing.assert_allclose(result.propagated(lambda m: m.f(*pair), by_channel=True), expected, rtol=1e-3)
    # Of the terms that change alone, which may have no channels.
    linear = result.propagated(lambda m: np.broadcast_to(m.f(*pair), 3), by_channel=True, linear=True)
    np.testing.assert_allclose(linear, result.propagated(lambda m: m.f(*pair), by_channel=True), rtol=1e-9)


def test_a_grey_model_of_a_table_in_colour_has_the_channels_of_the_table(tmp_path):
    """So that its file is read again, and says the same."""
    table = gonio.measure("lambert(rho=[0.2, 0.3, 0.4])", scan=gonio.scan("isotropic", step=np.radians(30)))
    result = gonio.fit(table, "lambert(rho=0.3)")
    result.save(tmp_path / "grey.toml")
    again = gonio.material(tmp_path / "grey.toml")
    assert (
        again.channels == result.channels and again.f(0.2, 0, 0.3, 1).shape == result.material.f(0.2, 0, 0.3, 1).shape
    )
    assert again.f(0.2, 0, 0.3, 1) == pytest.approx(np.full(3, 0.3 / np.pi))
