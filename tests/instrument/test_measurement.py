"""Measuring: readings against the model itself, the law of the noise, flags, provenance, blocks."""

import itertools
import json
import math
import re

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.hdf5.writer import open_table
from gonio.data.material import material_of
from gonio.data.subject import resolve_subject
from gonio.data.table import whole_table_of_values
from gonio.instrument import scans
from gonio.instrument.instrument import Instrument, Systematic
from gonio.instrument.measurement import measure
from gonio.instrument.reader import Reader, WorstAverage
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import from_spherical
from support.marks import thorough

PAINT = "lambert(rho=[.1, .2, .4]) + [1, .8, .6] * ggx(alpha=0.2, eta=1.5)"
SMALL = scans.isotropic(math.radians(15), phi_step=math.radians(20))
DISCS = {"source_half_angle": math.radians(1), "detector_half_angle": math.radians(2)}
REAL = {"photons": 3e4, "ambient": 0.02, "dark": 4.0, "read_noise": 3.0, "noise": 0.01}
OFF = Systematic(tilt_x=0.004, tilt_y=-0.003, theta_i=0.002, theta_o=0.005, phi=-0.01, gain=1.02)


def test_an_ideal_reading_is_the_models_value():
    for grid in (SMALL, layouts.merl(counts=(6, 7, 8)), scans.in_plane(math.radians(10)), small_list()):
        table = gonio.measure(PAINT, scan=grid)
        wi, wo = grid.directions()
        above = grid.readable()
        expected = np.where(above[:, None], evaluate(build(PAINT), wi, wo), np.nan)
        np.testing.assert_allclose(table.f.reshape(-1, 3), expected, rtol=1e-12)
        assert ((table.flag.reshape(-1, 3) == Flag.VALID) == above[:, None]).all()
        assert (table.flag.reshape(-1, 3)[~above] == Flag.BELOW_HORIZON).all()
        assert table.f.shape == (*grid.shape, 3) and not table.u_f.any()
        assert table.channels.names == ("R", "G", "B") and table.source_solid_angle == 0.0


def small_list():
    rng = np.random.default_rng(4)
    return layouts.scattered(*(rng.uniform(0, high, 40) for high in (1.57, 6.2, 1.57, 6.2)))


def test_a_material_may_come_in_any_form(tmp_path):
    tables = [measure(m, scan=SMALL) for m in (PAINT, build(PAINT), gonio.material(PAINT))]
    for table in tables:
        np.testing.assert_array_equal(table.f, tables[0].f)
    # On its own nodes an interpolated table is itself.
    again = measure(tables[0], scan=SMALL)
    np.testing.assert_allclose(again.f, tables[0].f, rtol=1e-12)
    path = tmp_path / "t.h5"
    measure(PAINT, scan=SMALL, output=path)
    np.testing.assert_allclose(measure(str(path), scan=SMALL).f, tables[0].f, rtol=1e-12)


def test_the_variance_of_readings_is_what_the_stored_uncertainty_says():
    grid = scans.isotropic(math.radians(5))
    assert grid.size >= 20_000
    instrument = Instrument(**REAL, systematic=OFF)
    calm = measure(PAINT, Instrument(systematic=OFF), grid)
    chi2 = []
    for seed in (1, 2):
        table = measure(PAINT, instrument, grid, seed=seed)
        z = ((table.f - calm.f) / table.u_f)[table.flag == Flag.VALID]
        chi2.append(np.mean(z**2))
        assert z.size > 69_000 and abs(z.mean()) < 4 / math.sqrt(z.size)
    spread = np.std(z**2) / math.sqrt(2 * z.size)
    assert abs(np.mean(chi2) - 1) < 4 * spread < 0.02
    assert chi2[0] != chi2[1]


def test_the_uncertainty_is_that_of_the_expected_reading_not_of_the_noisy_one():
    instrument = Instrument(photons=100)
    grid = layouts.scattered(*([a] * 500 for a in (0.3, 0.0, 0.5, 1.0)))
    table = measure("lambert(rho=0.5)", instrument, grid)
    assert np.unique(table.u_f).size == 1 and np.unique(table.f).size > 10
    # Counts of expectation n·ρ·cosθ: u = √n/(n_white cosθ π).
    n = 100 * 0.5 * math.cos(0.3)
    assert table.u_f[0, 0] == pytest.approx(math.sqrt(n) / (100 * math.pi * math.cos(0.3)), rel=1e-12)


@pytest.mark.parametrize("settings", [REAL | DISCS, {"noise": 0.1, "systematic": OFF}, *thorough(REAL, DISCS)])
def test_blocks_change_no_bit(settings):
    grid = scans.isotropic(math.radians(15), theta_max=math.radians(90), phi_step=math.radians(40))
    reader = Reader(material_of(build(PAINT)), Instrument(**settings), grid, 9)
    whole = reader.read(0, grid.size)
    cuts = [0, 63, 126, 252, grid.size] if reader.by_rows else [0, 1, 50, 51, 300, grid.size]
    worst = None
    for a, b in reversed(list(itertools.pairwise(cuts))):
        block = reader.read(a, b)
        for name in ("f", "u_f", "flag"):
            if getattr(block, name) is not None:
                np.testing.assert_array_equal(getattr(whole, name)[a:b], getattr(block, name))
        worst = WorstAverage.of(worst, block.worst)
    assert worst == whole.worst


def test_the_file_holds_what_memory_holds_in_either_precision(tmp_path):
    instrument = Instrument(**REAL, **DISCS, systematic=OFF, shadow=math.radians(8), saturation=5e3)
    table = measure(PAINT, instrument, SMALL, seed=3)
    stored = measure(PAINT, instrument, SMALL, seed=3, output=tmp_path / "t.h5")
    single = measure(PAINT, instrument, SMALL, seed=3, output=tmp_path / "s.h5", dtype="float32")
    for name in ("f", "u_f", "flag"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(table, name))
        assert single.f.dtype == np.float32
        np.testing.assert_array_equal(getattr(single, name), getattr(table, name).astype(getattr(single, name).dtype))
    same = [key for key in table.provenance if key != "created"]
    assert {k: stored.provenance[k] for k in same} == {k: table.provenance[k] for k in same}
    assert not list(tmp_path.glob("*.part"))
    flags = set(np.unique(table.flag))
    assert flags == {Flag.VALID, Flag.SHADOWED, Flag.SATURATED}
    assert np.isnan(table.f[table.flag != Flag.VALID]).all() and np.isfinite(table.f[table.flag == Flag.VALID]).all()


def test_the_provenance_says_all_that_is_needed_to_make_it_again():
    instrument = Instrument(**REAL, **DISCS, misalignment=math.radians(0.1), calibration=0.01)
    table = measure(PAINT, instrument, SMALL, seed=12, command="gonio measure ...")
    provenance = json.loads(json.dumps(table.provenance))
    assert provenance["seed"] == 12 and provenance["command"] == "gonio measure ..."
    assert provenance["instrument"]["photons"] == 3e4 and provenance["instrument"]["misalignment_deg"] == pytest.approx(
        0.1
    )
    assert set(provenance["versions"]) == {"gonio", "jax", "numpy", "python"}
    assert set(provenance["systematic"]) >= {"tilt_x_deg", "phi_deg", "gain"} and provenance["systematic"]["gain"] != 1
    assert 0 < provenance["aperture_error"]["relative"] < 1e-3
    errors = {name.removesuffix("_deg"): value for name, value in provenance["systematic"].items()}
    errors = {name: value if name == "gain" else math.radians(value) for name, value in errors.items()}
    again = Instrument(**REAL, **DISCS, systematic=Systematic(**errors))
    remade = measure(provenance["material"]["spelling"], again, table.layout, seed=provenance["seed"])
    np.testing.assert_allclose(remade.f, table.f, rtol=1e-9)
    assert table.source_solid_angle == pytest.approx(math.pi * math.radians(1) ** 2, rel=1e-4)
    assert measure(PAINT, scan=SMALL).provenance["instrument"] == "ideal"


def test_misalignment_moves_the_directions_and_the_irradiance_is_reckoned_from_the_tables_angle():
    errors = Systematic(theta_i=0.01, theta_o=-0.02, phi=0.03, gain=0.9)
    grid = scans.isotropic(math.radians(20), phi_step=math.radians(45))
    table = measure(PAINT, Instrument(systematic=errors), grid)
    theta_i, phi_i, theta_o, phi_o = grid.angles()
    wi, wo = from_spherical(theta_i + 0.01, phi_i), from_spherical(theta_o - 0.02, phi_o + 0.03)
    expected = np.asarray(evaluate(build(PAINT), wi, wo)) * (0.9 * np.cos(theta_i + 0.01) / np.cos(theta_i))[:, None]
    np.testing.assert_allclose(table.f.reshape(-1, 3), expected, rtol=1e-12)


def test_flags_say_why_a_cell_has_no_value():
    shadow = math.radians(20)
    table = measure("lambert(rho=0.9)", Instrument(shadow=shadow), SMALL)
    wi, wo = SMALL.directions()
    apart = np.arccos(np.clip(sum(a * b for a, b in zip(wi, wo, strict=True)), -1, 1))
    np.testing.assert_array_equal(table.flag.ravel() == Flag.SHADOWED, apart < shadow)
    full = measure("lambert(rho=0.9)", Instrument(photons=1e6, saturation=5e5), SMALL)
    counts = 1e6 * 0.9 * np.cos(SMALL.angles()[0])
    assert (full.flag.ravel()[counts > 5.1e5] == Flag.SATURATED).all()
    assert (full.flag.ravel()[counts < 4.9e5] == Flag.VALID).all()


def test_where_a_table_has_nothing_nothing_is_measured():
    plane = scans.in_plane(math.radians(10))
    ones = whole_table_of_values(plane, np.ones(plane.shape))
    table = measure(ones, Instrument(**REAL), SMALL)
    delta = SMALL.angles()[3]
    in_plane = (np.abs(np.sin(delta)) < 1e-9) | (SMALL.angles()[2] == 0)
    np.testing.assert_array_equal(table.flag.ravel() == Flag.VALID, in_plane | (SMALL.angles()[0] == 0))
    assert (table.flag.ravel()[~(in_plane | (SMALL.angles()[0] == 0))] == Flag.NOT_MEASURED).all()


class Dark(AbstractBRDF):
    """A table's noise floor: f is slightly below zero everywhere."""

    def formula(self, wi, wo):
        return -0.01 + 0 * wi.z


def test_negative_readings_are_kept():
    table = measure(Dark(), Instrument(photons=1e4, noise=0.01), SMALL)
    assert (table.flag == Flag.VALID).all() and (table.f < 0).mean() > 0.9
    assert table.counts()["negative"] == np.count_nonzero(table.f < 0)
    z = (table.f + 0.01) / table.u_f
    assert abs(np.mean(z**2) - 1) < 4 * math.sqrt(2 / z.size) + 0.05


def test_averages_that_the_rays_do_not_resolve_are_reported():
    grid = layouts.in_plane([math.radians(85)], [math.radians(70), math.radians(85)])
    discs = Instrument(source_half_angle=0.05, detector_half_angle=0.05)
    with pytest.warns(UserWarning, match=r"not resolved everywhere: at theta_i = 85°, theta_o = 85°"):
        table = measure("ggx(alpha=0.0005)", discs, grid)
    assert table.provenance["aperture_error"]["excess"] > 10


def test_an_anisotropic_sample_is_turned_or_a_remark_made():
    brushed = "ggx(alpha_x=0.1, alpha_y=0.3)"
    assert scans.default_name(build(brushed)) == "spherical"
    assert scans.default_name(build(PAINT)) == "isotropic"
    assert scans.default_name(build("ward(alpha_x=0.0001, alpha_y=0.0002)")) == "spherical", "too narrow for any pair"
    with pytest.warns(UserWarning, match="never turns the sample"):
        one_way = measure(brushed, scan=SMALL)
    turned = measure(brushed, scan=scans.spherical(math.radians(30), theta_max=math.radians(60)))
    assert not scans.is_isotropic(resolve_subject(turned).brdf)
    assert scans.is_isotropic(resolve_subject(one_way).brdf), "an isotropic layout answers alike all round"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed": -1}, "the seed is -1"),
        ({"seed": 1.5}, "the seed is 1.5"),
        ({"dtype": "int16"}, "int16 cannot be stored"),
        ({"scan": "spiral"}, "scan 'spiral' is unknown"),
        ({"scan": scans.spherical(math.radians(0.75), theta_max=math.radians(45))}, "GB of memory; give an output"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_a_sentence(arguments, message):
    with pytest.raises(GonioError, match=message) as error:
        measure("lambert(rho=0.5)", **arguments)
    assert "\n" not in str(error.value)


def test_an_output_is_not_overwritten(tmp_path):
    path = tmp_path / "t.h5"
    measure("lambert(rho=0.5)", scan=SMALL, output=path)
    with pytest.raises(GonioError, match="exists already"):
        measure("lambert(rho=0.6)", scan=SMALL, output=path)
    measure("lambert(rho=0.6)", scan=SMALL, output=path, force=True)
    assert open_table(path).f[0, 0, 0, 0] == pytest.approx(0.6 / math.pi)


def test_remarks_and_the_rate_are_logged_and_the_old_name_of_the_option_works():
    lines = []
    measure("ggx(alpha_x=0.1, alpha_y=0.3)", scan=SMALL, log=lines.append)
    assert "never turns the sample" in lines[0] and re.fullmatch(r"648 cells in .* s, .* cells/s", lines[-1])
    with pytest.warns(DeprecationWarning, match="say is called log now") as warned:
        measure("lambert(rho=0.5)", scan=SMALL, say=lines.append)
    assert len(warned) == 1 and len(lines) == 3
    with pytest.raises(TypeError, match="measure has no option 'seeds'; did you mean 'seed'"):
        measure("lambert(rho=0.5)", scan=SMALL, seeds=3)
    with pytest.raises(TypeError, match="step is an option of the scan"):
        measure("lambert(rho=0.5)", scan="isotropic", step=0.1)  # pyright: ignore[reportCallIssue]


def test_no_bar_is_written_where_no_terminal_is(capfd):
    from gonio.instrument import measurement

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measurement, "PATIENCE", 0.0)
        measure("lambert(rho=0.5)", Instrument(source_half_angle=0.01), SMALL, progress=True)
        assert capfd.readouterr() == ("", "")
        patch.setenv("FORCE_COLOR", "1")  # a terminal, for rich
        measure("lambert(rho=0.5)", Instrument(source_half_angle=0.01), scans.isotropic(math.radians(5)), progress=True)
        assert "cells/s" in capfd.readouterr().err
