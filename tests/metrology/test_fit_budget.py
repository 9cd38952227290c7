"""What moves fitted numbers: as much as a fit of readings that really were in error moves them."""

import math

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.data import layouts
from gonio.instrument import Instrument, measure
from gonio.instrument.instrument import Systematic
from gonio.instrument.scans import scan
from gonio.metrology.quantities import quantities
from gonio.models.errors import GonioError

GRID = scan("isotropic", step=math.radians(15), theta_max=math.radians(75))
TRUTH, MODEL = "lambert(rho=0.3) + 0.5 * ggx(alpha=0.3)", "lambert + ggx"
SMALL = 2e-4
NUMBERS = ("lambert.rho", "ggx.alpha", "ggx.scale")


def numbers(fitted):
    return np.array([p.value for p in fitted.parameters if p.status != "fixed"])


@pytest.fixture(scope="module")
def exact():
    return measure(TRUTH, Instrument(), GRID)


@pytest.fixture(scope="module")
def fitted(exact):
    return gonio.fit(exact, MODEL)


ERRORS = ("tilt_x", "tilt_y", "theta_i", "theta_o", "phi", "gain", "dark")


@pytest.fixture(scope="module")
def contributions(exact, fitted):
    """What each error of the instrument adds to the budget of the fit, by its name."""
    stated = {name: SMALL if name in ("gain", "dark") else f"{SMALL} rad" for name in ERRORS}
    b = quantities(exact, budget=True, only=["reflectance"], fit=fitted, uncertainty=stated).budget
    return {c.name: c for c in b.contributions}


@pytest.mark.parametrize("name", ERRORS)
def test_a_real_error_of_the_instrument_moves_a_fit_by_its_contribution(fitted, contributions, name):
    contribution = contributions[name]
    error = {"gain": {"gain": 1 + SMALL}, "dark": {"offset": SMALL}}.get(name, {name: SMALL})
    moved = gonio.fit(measure(TRUTH, Instrument(systematic=Systematic(**error)), GRID), MODEL)
    change = numbers(moved) - numbers(fitted)
    # To first order: tilt about x and the azimuth do nothing to an isotropic surface.
    assert contribution.values[-8:-5] == pytest.approx(change, abs=max(0.02 * np.abs(change).max(), 3e-6))


def test_numbers_and_their_albedos_are_quantities_with_the_noise_of_repeated_fits():
    instrument = Instrument(photons=1e5, dark=100.0)
    tables = [measure(TRUTH, instrument, GRID, seed=s) for s in range(30)]
    fits = [gonio.fit(t, MODEL, starts=0) for t in tables]
    result = quantities(tables[0], budget=True, only=["reflectance"], fit=fits[0])
    rows = [k for k, q in enumerate(result.quantities) if q.name in NUMBERS]
    parts = [c.values[rows] for c in result.budget.contributions if c.name in ("counting", "background")]
    spread = np.std([numbers(f) for f in fits], axis=0, ddof=1)
    assert len(parts) == 2 and spread / np.hypot(*parts) == pytest.approx(1, abs=0.4)
    assert result.budget.standard[rows] == pytest.approx(np.hypot(*parts))
    at_45 = next(q for q in result.quantities if q.name == "albedo of the fit" and q.place == "θi 45°")
    assert at_45.value == pytest.approx(gonio.material(TRUTH).albedo(45, degrees=True).value[0], rel=0.01)


def test_what_a_wrong_model_leaves_out_is_a_source_and_alignment_that_explains_it_is_not():
    instrument = Instrument(photons=1e7, misalignment=1e-3)
    table = measure(TRUTH, instrument, GRID, seed=3)
    right, wrong = (
        quantities(table, budget=True, only=["reflectance"], fit=m).budget for m in (MODEL, "lambert + beckmann")
    )
    assert "model" not in [c.name for c in right.contributions]
    left_out = next(c for c in wrong.contributions if c.name == "model")
    assert left_out.values.max() > 0 and math.isfinite(left_out.dof)


def test_a_fits_file_is_fitted_again_and_slopes_of_lists_come_from_the_model(tmp_path, exact):
    rng = np.random.default_rng(5)
    theta_i, theta_o = np.arccos(np.sqrt(rng.uniform(0.1, 1, (2, 200))))
    phi = rng.uniform(0, 2 * np.pi, 200)
    table = gonio.Table.from_arrays(theta_i, 0, theta_o, phi, gonio.material(TRUTH).f(theta_i, 0, theta_o, phi))
    table.save(tmp_path / "t.h5")
    gonio.fit(table, MODEL).save(tmp_path / "f.toml")
    result = quantities(
        tmp_path / "t.h5", budget=True, only=["reflectance"], fit=tmp_path / "f.toml", uncertainty={"tilt": "0.1 deg"}
    )
    assert "tilt_x" not in result.budget.missing and "theta_i" in result.budget.missing
    assert [q.name for q in result.quantities if q.place == "fit"] == [*NUMBERS]
    with pytest.raises(GonioError, match="is not a fitted material"):
        quantities(exact, fit=tmp_path / "t.h5")
    with pytest.raises(GonioError, match="does not exist"):
        quantities(exact, fit="none.toml")
    with pytest.raises(GonioError, match="channel by channel"):
        both = measure("lambert(rho=[0.2, 0.4]) + ggx(alpha=0.3)", Instrument(), GRID)
        quantities(both, budget=True, only=["reflectance"], fit=gonio.fit(both, MODEL, per_channel=True, starts=0))


def test_the_command_line_shows_fitted_numbers(tmp_path, exact, capsys):
    exact.save(tmp_path / "t.h5")
    assert main(["quantities", str(tmp_path / "t.h5"), "--budget", "--fit", MODEL, "--uncertainty", "gain=1 %"]) == 0
    out = capsys.readouterr().out
    assert "ggx.alpha" in out and "albedo of the fit" in out
    assert main(["quantities", str(tmp_path / "t.h5"), "--fit", "lambret"]) == 2
    assert main(["quantities", "gold", "--fit", MODEL]) == 2
    assert "is a model" in capsys.readouterr().err


def test_a_calibration_moves_albedos_and_transmittances_of_a_sheet_alike():
    """All of f of a sheet is linear in ρ and τ: a gain of 1 % is 1 % of each."""
    both = np.radians(np.arange(0.0, 181.0, 20.0))
    layout = layouts.isotropic(both[:4], both, np.radians(np.arange(0.0, 360.0, 60.0)))
    table = measure("thin_sheet(rho=0.3, tau=0.5)", Instrument(), layout)
    q = quantities(table, budget=True, only=["reflectance"], fit="thin_sheet", uncertainty={"gain": "1 %"})
    u = {(row.name, row.place): s / row.value for row, s in zip(q.quantities, q.budget.standard, strict=True)}
    for name in ("albedo of the fit", "transmittance of the fit"):
        assert [u[name, f"θi {t}°"] for t in (0, 30, 45, 60, 75)] == pytest.approx([0.01] * 5, rel=1e-6)
