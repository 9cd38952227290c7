"""The adaptive measurement of the RGL instrument: normals from retro-reflection, and readings where they reflect."""

import numpy as np
import pytest

from gonio.data.flags import Flag
from gonio.data.formats.rgl_file import read_rgl
from gonio.data.formats.rgl_write import write_arrays
from gonio.data.interpolation.rgl_data import projected_area
from gonio.data.interpolation.rgl_warp import RGLMaterial
from gonio.data.subject import load_material
from gonio.instrument.instrument import Instrument
from gonio.instrument.measurement import measure
from gonio.instrument.rgl_scan import measure_rgl, retro_layout
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, half_vector

ROUGH = "beckmann(alpha=0.3)"
SMALL = {"incidences": 4, "samples": 12, "log": lambda text: None}


@pytest.fixture(scope="module")
def scan():
    return measure_rgl(ROUGH, Instrument(photons=1e8), seed=3, **SMALL)


def test_normals_are_those_of_the_surface(scan):
    """A Beckmann surface shadows nearly as the procedure assumes."""
    data, alpha = scan.fit.data, 0.3
    theta = np.linspace(0, 1, data.ndf.shape[1]) ** 2 * np.pi / 2
    steep = np.tan(theta[:60])
    expected = np.exp(-((steep / alpha) ** 2)) / (np.pi * alpha**2 * np.cos(theta[:60]) ** 4)
    np.testing.assert_allclose(data.ndf[0, :60], expected, rtol=0.03, atol=0.02 * expected.max())
    np.testing.assert_array_equal(data.ndf[0], data.ndf[1])
    polar = np.radians([0.0, 30.0, 50.0])
    np.testing.assert_allclose(projected_area(data.sigma, polar, 0 * polar), np.cos(polar), rtol=0.02)


def test_the_file_reads_as_what_was_measured(scan, tmp_path):
    write_arrays(tmp_path / "m.bsdf", scan.fit)
    again = read_rgl(tmp_path / "m.bsdf")
    readings = scan.table.read(scan.retro_cells)
    both = (again.flag == Flag.VALID) & (readings.flag[:, :1] == Flag.VALID)
    assert both[:, 0].sum() > 0.4 * both.shape[0]
    np.testing.assert_allclose(again.f[both], np.broadcast_to(readings.f, again.f.shape)[both], rtol=1e-3, atol=1e-5)
    np.testing.assert_array_equal((again.flag == Flag.VALID)[:, 0], scan.fit.valid.ravel())


def test_it_stands_for_the_material(scan):
    rng = np.random.default_rng(0)
    z, phi = rng.uniform(0.4, 1, (2, 300)), rng.uniform(0, 2 * np.pi, (2, 300))
    wi, wo = (
        Direction(np.sqrt(1 - c**2) * np.cos(p), np.sqrt(1 - c**2) * np.sin(p), c) for c, p in zip(z, phi, strict=True)
    )
    truth = np.asarray(evaluate(load_material(ROUGH).brdf, wi, wo))
    error = np.asarray(evaluate(RGLMaterial(scan.fit.data), wi, wo))[:, 0] / truth - 1
    assert np.median(np.abs(error[truth > 1e-3])) < 0.03


def test_the_readings_of_retro_reflection_count(scan):
    first = measure(ROUGH, Instrument(photons=1e8), retro_layout(False, np.radians(85), 0.0), seed=3)
    np.testing.assert_array_equal(scan.table.read(0, scan.retro_cells).f, first.f)
    about = scan.table.provenance["scan"]
    assert about["retro_cells"] == first.layout.size and about["hours"] == scan.hours > 0
    angles = [a[scan.table.layout.readable()] for a in scan.table.layout.angles()]
    assert scan.hours * 3600 > len(angles[0]) * Instrument().seconds


@pytest.mark.parametrize("anisotropic", [False, True])
def test_beside_the_shadow_the_half_vector_stays(anisotropic):
    shadow = np.radians(5)
    together, apart = retro_layout(anisotropic, 1.4, 0.0), retro_layout(anisotropic, 1.4, shadow)
    m, _ = together.directions()
    wi, wo = apart.directions()
    np.testing.assert_allclose(half_vector(wi, wo), m, atol=1e-12)
    assert (np.arccos(sum(a * b for a, b in zip(wi, wo, strict=True))) > shadow).all()


def test_a_shadow_and_an_anisotropic_surface():
    scan = measure_rgl("beckmann(alpha_x=0.2, alpha_y=0.5)", Instrument(shadow=np.radians(4)), **SMALL)
    flag = scan.table.read_values()["flag"]
    assert (flag[: scan.retro_cells] != Flag.SHADOWED).all()
    assert scan.fit.data.phi_i.size == 7 and scan.fit.data.reduction == 4
    row = scan.fit.data.ndf.shape[0] // 2
    along, across = (int(k * row) for k in (1, 0.5))  # azimuths 0 and −90 degrees
    column = 60
    assert scan.fit.data.ndf[across, column] > 2 * scan.fit.data.ndf[along, column]
    assert np.isfinite(scan.fit.data.spectra).all() and scan.fit.data.spectra.min() >= 0


def test_what_tells_no_normals_is_refused():
    with pytest.raises(GonioError, match="sends no light back"):
        measure_rgl("lambert(rho=0)", **SMALL)
    with pytest.raises(GonioError, match="1 incidences"):
        measure_rgl(ROUGH, incidences=1)
    with pytest.raises(GonioError, match="no reading of retro-reflection is valid"):
        measure_rgl(ROUGH, Instrument(ranges=((1.5, 1.55), (0, 6.28), (0, 0.1), (0, 6.28))), **SMALL)


def test_normals_that_have_not_settled_are_told(scan, monkeypatch):
    monkeypatch.setattr("gonio.instrument.rgl_scan.MOST_STEPS", 1)
    with pytest.warns(UserWarning, match="distribution of normals still changed by"):
        measure_rgl(ROUGH, **SMALL)
