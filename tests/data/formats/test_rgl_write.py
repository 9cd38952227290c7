"""RGL files written by gonio: agreement with the model as Mitsuba and as gonio read them."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.registry import read, write
from gonio.data.formats.rgl_file import read_rgl_data, read_tensors
from gonio.data.formats.rgl_write import rgl_fields, tensor_bytes, write_rgl
from gonio.data.interpolation.rgl_fit import fit_rgl
from gonio.data.interpolation.rgl_layout import RGLLayout, sectors_of
from gonio.data.interpolation.rgl_warp import RGLMaterial
from gonio.data.subject import load_material
from gonio.data.table import whole_table_of_values
from gonio.data.tabulate import grid_values
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from support.mitsuba_client import f_cosine

PAINT = "lambert(rho=[0.3, 0.1, 0.05]) + ggx(alpha=0.2, f0=0.04)"
BRUSHED = "ggx(alpha_x=0.2, alpha_y=0.5, eta=0.2, k=3)"
SPECTRAL = "aluminium"


def directions(n, seed, limit=80.0):
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(np.cos(np.radians(limit)), 1, n), rng.uniform(0, 2 * np.pi, n)
    s = np.sqrt(1 - z**2)
    return Direction(s * np.cos(phi), s * np.sin(phi), z)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("rgl")


@pytest.fixture(scope="module")
def paint(folder):
    return folder / "paint.bsdf", write(folder / "paint.bsdf", load_material(PAINT), channel_bytes=8192)


@pytest.fixture(scope="module")
def brushed(folder):
    return folder / "brushed.bsdf", write(folder / "brushed.bsdf", load_material(BRUSHED), channel_bytes=2048)


def mitsubas(path, wi, wo, wavelengths=None):
    """f·cosθo by Mitsuba's `measured` plugin."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb" if wavelengths is None else "scalar_spectral")
    return f_cosine(mi.load_dict({"type": "measured", "filename": str(path)}), wi, wo, wavelengths)


@pytest.mark.parametrize("kind", ["paint", pytest.param("brushed", marks=pytest.mark.thorough)])
def test_mitsuba_reads_the_model(kind, request):
    path, _ = request.getfixturevalue(kind)
    wi, wo = directions(400, 1), directions(400, 2)
    f_cos = mitsubas(path, wi, wo)
    expected = np.asarray(evaluate(load_material(PAINT if kind == "paint" else BRUSHED).brdf, wi, wo))
    expected = expected.reshape(400, -1) * wo.z[:, None]
    error = np.abs(f_cos / expected - 1)
    assert np.median(error) < (0.01 if kind == "paint" else 0.05)
    assert f_cos.min() >= 0
    ours = np.asarray(evaluate(read(path).interpolant(), wi, wo)) * wo.z[:, None]
    np.testing.assert_allclose(f_cos, ours, rtol=1e-4, atol=1e-6)


def test_mitsubas_sampler_reflects_the_albedo(paint):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    bsdf = mi.load_dict({"type": "measured", "filename": str(paint[0])})
    si, rng = mi.SurfaceInteraction3f(), np.random.default_rng(0)
    theta = 0.8
    si.wi = [np.sin(theta), 0.0, np.cos(theta)]
    weights = [np.array(bsdf.sample(mi.BSDFContext(), si, 0.5, u)[1]) for u in rng.random((4000, 2)).tolist()]
    albedo = load_material(PAINT).albedo(theta).value
    mean, spread = np.mean(weights, axis=0), np.std(weights, axis=0)
    assert np.min(weights) >= 0 and np.isfinite(weights).all()
    np.testing.assert_allclose(mean, albedo, rtol=0.02)
    assert (spread < 0.6 * mean).all()


def test_wavelengths_are_a_spectrum(folder):
    material = load_material(SPECTRAL)
    trip = write(folder / "s.bsdf", material, channel_bytes=2048)
    fields, nodes = read_tensors(folder / "s.bsdf"), material.channels.wavelengths_nm
    np.testing.assert_array_equal(fields["wavelengths"], np.array(nodes, np.float32))
    assert fields["spectra"].shape[2] == len(nodes) and trip.lost == 0
    wi, wo = directions(100, 1, 60), directions(100, 2, 60)
    f_cos = mitsubas(folder / "s.bsdf", wi, wo, nodes[1:5])
    expected = np.asarray(evaluate(material.brdf, wi, wo))[:, 1:5] * wo.z[:, None]
    assert np.median(np.abs(f_cos / expected - 1)) < 0.02


def test_the_file_holds_the_fitted_arrays_bit_for_bit(tmp_path):
    brdf = load_material("lambert(rho=0.5)").brdf
    fit = fit_rgl(brdf, Channels.grey(), RGLLayout.of_bytes(1024, None), lambda wi, wo: wi.z > 0.5, "text")
    fields = rgl_fields(fit)
    (tmp_path / "m.bsdf").write_bytes(tensor_bytes(fields))
    again = read_tensors(tmp_path / "m.bsdf")
    assert list(again) == list(fields)
    for name, array in fields.items():
        assert again[name].dtype == array.dtype
        np.testing.assert_array_equal(again[name], array)
    data = read_rgl_data(tmp_path / "m.bsdf")
    np.testing.assert_array_equal(data.valid, fit.valid)
    np.testing.assert_array_equal(data.spectra, np.repeat(fit.data.spectra.astype(np.float32), 3, axis=2))
    assert data.description == "text" and data.jacobian and 0.3 < fit.covered < 0.9


def test_no_value_is_negative_above_the_horizon(paint):
    material = RGLMaterial(read_rgl_data(paint[0]))
    wi, wo = directions(100_000, 3, 89.9), directions(100_000, 4, 90)
    assert np.asarray(evaluate(material, wi, wo)).min() >= 0


@pytest.mark.thorough
def test_a_scanned_table_is_written_as_its_model(tmp_path, paint):
    polar, around = np.radians(np.arange(0, 86, 5.0)), np.radians(np.arange(0, 181, 10.0))
    grid = layouts.isotropic(polar, polar, around)
    table = whole_table_of_values(grid, grid_values(load_material(PAINT).brdf, grid), Channels.rgb(), name="scan")
    trip = write(tmp_path / "t.bsdf", table, channel_bytes=4096)
    assert trip.lost == 0 and trip.compared == 3 * table.layout.readable().sum()
    assert "have no reading" in trip.note  # beyond 85 degrees
    data = read_rgl_data(tmp_path / "t.bsdf")
    again = read(tmp_path / "t.bsdf")
    assert (again.flag == Flag.NOT_MEASURED).any() and not data.valid.all()
    wi, wo = again.layout.directions()
    polar = np.degrees(np.arccos(np.minimum(wi.z, wo.z)[again.flag[:, 0] == Flag.VALID]))
    assert polar.max() < 85.01
    wi, wo = directions(500, 5, 70), directions(500, 6, 70)
    error = np.asarray(evaluate(again.interpolant(), wi, wo)) / np.asarray(evaluate(load_material(PAINT).brdf, wi, wo))
    assert np.median(np.abs(error - 1)) < 0.02


def test_what_no_rgl_file_holds_is_refused(tmp_path):
    grid = layouts.isotropic(np.radians([0.0, 10.0]), np.radians([0.0, 10.0]), np.radians([0.0, 180.0]))
    small = whole_table_of_values(grid, np.ones(grid.shape))
    with pytest.raises(GonioError, match=r"has readings for .* % of the directions"):
        write_rgl(tmp_path / "m.bsdf", small, channel_bytes=1024)
    with pytest.raises(GonioError, match="there are 4 channels without wavelengths"):
        write_rgl(tmp_path / "m.bsdf", whole_table_of_values(grid, np.ones((*grid.shape, 4))))
    with pytest.raises(GonioError, match="give from 1024 to"):
        write_rgl(tmp_path / "m.bsdf", load_material("grey_card"), channel_bytes=7)
    with pytest.raises(GonioError, match="holds readings; measure it first"):
        write(tmp_path / "m.csv", load_material("grey_card"))
    with pytest.raises(GonioError, match="no option 'channel_bytes'"):
        write(tmp_path / "m.csv", small, channel_bytes=4096)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("expression", "sectors"),
    [("lambert(rho=0.3)", None), ("ggx(alpha_x=0.1, alpha_y=0.4)", 4), ("ward(alpha_x=0.1, alpha_y=0.4)", 4)],
)
def test_the_symmetry_of_a_surface_decides_which_azimuths_are_stored(expression, sectors):
    assert sectors_of(load_material(expression).brdf) == sectors
    layout = RGLLayout.of_bytes(16384, sectors)
    assert layout.nodes // layout.phi_i.size * 4 <= 16384
    assert layout.isotropic == (sectors is None)
