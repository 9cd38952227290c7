"""Outliers: found, counted, set aside, and no cost to clean readings."""

import numpy as np
import pytest
import scipy.stats
from scipy.optimize import brentq

from gonio.data.flags import Flag
from gonio.fitting.fit_table import fit
from gonio.fitting.solver.robust_weights import KINDS, scales
from gonio.models.errors import GonioError
from support.fit_tables import table_of, values

TRUTH = "lambert(rho=.2)+0.5*ggx(alpha=0.3)"
NUMBERS = np.array([0.2, 0.3, 0.5])
SCALE_ERROR = 1.2  # of a scale from a class of 60 readings: three standard deviations of a median absolute deviation


def spoilt(share=0.01, factor=100.0, noise=0.01, seed=0):
    table = table_of(TRUTH, noise=noise, seed=seed)
    rng = np.random.default_rng(seed + 1)
    hit = (rng.random(table.f.shape) < share) & (table.flag == Flag.VALID)
    table.f[hit] *= factor
    return table, hit


@pytest.mark.parametrize("kind", list(KINDS))
def test_slopes_of_weights(kind):
    t = np.linspace(-8, 8, 161) + 1e-3
    w, slope = KINDS[kind](t)
    h = 1e-6
    psi = [KINDS[kind](t + e)[0] * (t + e) for e in (h, -h)]
    np.testing.assert_allclose(slope, (psi[0] - psi[1]) / (2 * h), atol=1e-7)
    assert np.all(w >= 0) and KINDS[kind](np.zeros(1))[0] == pytest.approx(1, abs=0.3)


def test_scales_follow_brightness():
    rng = np.random.default_rng(0)
    model = np.geomspace(0.01, 100, 20_000)[:, None]
    s = scales(0.1 * model * rng.standard_normal(model.shape), model, np.ones_like(model, bool))
    assert np.median(s[-1000:] / (0.1 * model[-1000:])) == pytest.approx(1, rel=0.2)
    assert s[-1, 0] > 100 * s[0, 0]


@pytest.mark.parametrize("kind", list(KINDS))
def test_one_percent_a_hundred_times_too_bright(kind):
    table, hit = spoilt()
    result = fit(table, "lambert + ggx", robust=kind, starts=2)
    u = np.array([p.standard_uncertainty for p in result.parameters if p.status != "fixed"])
    assert result.converged and np.all(np.abs(values(result) - NUMBERS) < 5 * u) and np.all(u < 0.002)
    outlying = hit.reshape(-1, hit.shape[-1])[np.any(table.flag == Flag.VALID, axis=-1).ravel()]
    light = result.evidence.robust.kept < 0.5
    assert light.shape == outlying.shape and light[outlying].all()
    # Of normal noise, the share whose weight falls below a half is that of the weight's own law.
    t = brentq(lambda t: KINDS[kind](np.array([t]))[0][0] - 0.5, 0.0, 10.0)
    clean = scipy.stats.binom(np.count_nonzero(~outlying), 2 * scipy.stats.norm.sf(t / SCALE_ERROR))
    assert np.count_nonzero(light[~outlying]) <= clean.ppf(1 - 1e-4)
    words = " ".join(result.residuals.sentences)
    assert f"robust ({kind})" in words and result.residuals.down_weighted == np.count_nonzero(light)
    assert result.robust == kind


def test_least_squares_says_that_outliers_lead_it():
    table, hit = spoilt()
    result = fit(table, "lambert + ggx", starts=2)
    assert np.max(np.abs(values(result) / NUMBERS - 1)) > 0.02
    assert any("robust fit counts them less" in s for s in result.residuals.sentences)
    assert result.residuals.standing_out == pytest.approx(hit.sum() / result.samples, rel=0.6)


def test_clean_readings_lose_little():
    """Tukey's weights cost 5 % of efficiency with normal noise: errors and uncertainties stay nearly the same."""
    table = table_of(TRUTH, noise=0.02)
    plain, robust = (fit(table, "lambert + ggx", starts=2, robust=r) for r in (None, True))
    u = [np.array([p.standard_uncertainty for p in r.parameters if p.status != "fixed"]) for r in (plain, robust)]
    np.testing.assert_allclose(u[1] / u[0], 1.03, atol=0.08)
    assert np.all(np.abs(values(plain) - values(robust)) < u[0])


def test_unknown_weights_are_refused():
    with pytest.raises(GonioError, match="tukey"):
        fit(table_of(TRUTH), "lambert + ggx", robust="tuky")
