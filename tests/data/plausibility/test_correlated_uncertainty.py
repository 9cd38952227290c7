"""What readings share of their stored uncertainties: a calibration that every verb has to count."""

import math

import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.layouts import Layout
from gonio.data.plausibility.correlated_uncertainty import correlated_uncertainty
from gonio.data.table import Table, whole_table_of_values
from gonio.fitting.judgement import COMMON
from support.tables import list_in_planes

STATED = 0.015
"""Relative standard uncertainty of each reading."""
POLAR = np.radians(np.arange(0, 86, 5))
GRID = layouts.isotropic(POLAR, np.radians(np.arange(0, 91, 5)), np.radians(np.arange(0, 360, 20)))


def read(
    layout: Layout, scatter: float, off: float, material: str = "lambert(rho=0.4) + 0.2 * ggx(alpha=0.5)"
) -> Table:
    """Readings off by a share together and by `scatter` of their stated uncertainty each."""
    f = gonio.material(material).f(*layout.angles())
    f = f * (1 + off) * (1 + scatter * STATED * np.random.default_rng(1).standard_normal(f.shape))
    values = f.reshape(*layout.shape, 1)
    return whole_table_of_values(layout, values, u_f=STATED * values)


@pytest.mark.parametrize("layout", [GRID, list_in_planes()], ids=["grid", "list"])
def test_what_scatter_does_not_explain_is_shared(layout):
    for scatter in (0.05, 0.3):
        known = correlated_uncertainty(read(layout, scatter, 0.0))
        # The median of some 180 χ² or more is known to a tenth; curvature counts as scatter.
        assert 0.8 * scatter < known.scatter < 1.2 * scatter + 0.05
        assert known.relative == pytest.approx(STATED * math.sqrt(1 - known.scatter**2), rel=0.02)
    assert correlated_uncertainty(read(layout, 1.0, 0.0)).relative == 0


def test_dark_readings_keep_the_noise_of_their_own():
    """Each is off by a floor of noise beside the calibration that all share: both come out, wherever f is."""
    f = gonio.material("lambert(rho=0.01) + 0.2 * ggx(alpha=0.25)").f(*GRID.angles()).reshape(*GRID.shape, 1)
    floor = 0.1 * STATED * np.quantile(f, 0.75)
    values = f + floor * np.random.default_rng(3).standard_normal(f.shape)
    u_f = np.hypot(STATED * f, floor)
    known = correlated_uncertainty(whole_table_of_values(GRID, values, u_f=u_f))
    assert known.relative == pytest.approx(STATED, rel=0.1)
    dark = f < np.quantile(f, 0.1)
    np.testing.assert_allclose(known.independent(f, u_f)[dark], floor, rtol=0.2)


def test_exact_pairs_of_a_coarse_grid_tell_and_copies_do_not():
    coarse = layouts.isotropic(POLAR[::3], POLAR[::3], np.radians(np.arange(0, 360, 20)))
    assert correlated_uncertainty(read(coarse, 0.2, 0.0)).relative == pytest.approx(STATED, rel=0.05)
    noisy = read(coarse, 1.0, 0.0)
    copied = np.array(noisy.f)
    copied[:, :, :8:-1] = copied[:, :, 1:10]  # each azimuth φ at −φ: one reading twice
    table = whole_table_of_values(coarse, copied, u_f=STATED * copied)
    assert correlated_uncertainty(table).relative == 0


def test_a_calibration_in_the_stored_uncertainties_reaches_every_verb():
    """All readings 2.5 % too high, each stated to 1.5 %: no certificate may fail it, no interval may miss."""
    white = read(GRID, 0.1, 0.025, "lambert(rho=0.99)")
    certified = {p.name: p for p in gonio.check(white, against="lambert(rho=0.94)").properties}
    for name in ("energy", "agreement"):
        assert certified[name].verdict == "undecided" and "share of their stored" in certified[name].detail
    result = gonio.quantities(white, only="albedo", budget=True)
    albedo = next(k for k, q in enumerate(result.quantities) if q.place == "θi 0°")
    q = next(q for q in gonio.quantities(white, only="albedo").quantities if q.place == "θi 0°")
    assert abs(q.value - 0.99) < 2 * q.uncertainty and result.budget.standard[albedo] == pytest.approx(q.uncertainty)
    assert q.u == pytest.approx(STATED * q.value, rel=0.02) and any("scatter by at most" in n for n in result.notes)
    fitted = gonio.fit(read(GRID, 0.1, 0.025, "lambert(rho=0.4)"), "lambert")
    assert fitted.judgement.verdict == "fair" and fitted.common_errors[0]["meaning"] == COMMON
    assert fitted.common_errors[0]["stated"] == pytest.approx(STATED, rel=0.02)


def test_as_much_too_high_by_readings_that_scatter_as_stated_fails():
    energy = next(p for p in gonio.check(read(GRID, 1.0, 0.025, "lambert(rho=0.99)")).properties if p.name == "energy")
    assert energy.verdict == "fail"
