"""Sketches: the numbers of the models they stand for, derivatives, bounds, held-out readings without refits."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.fitting.selection import criteria
from gonio.fitting.selection.candidate_model import CandidateProblem, Part, Scenery, residuals, values
from gonio.fitting.selection.warm_start import carried, fitted
from gonio.fitting.solver.levenberg_marquardt import minimise
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

THETA = np.radians(np.arange(0, 81, 20.0))
LAYOUT = layouts.spherical(THETA, np.radians([0, 60, 120.0]), THETA, np.radians(np.arange(0, 360, 40.0)))
WI, WO = LAYOUT.directions()
MIXED = (Part("lambert", grey=True), Part("ggx", 0.04, spread=True), Part("ggx", None, brushed=True))
MIXED_P = np.array([0.2, 0.5, 0.6, 0.7, 0.3, 0.35, 0.4, 0.2, 0.3, 0.1, 0.1, 0.25, 0.5])
MIXED_SPELLED = (
    "lambert(rho=0.2) + [0.5, 0.6, 0.7] * ggx(alpha=[0.3, 0.35, 0.4], f0=0.04)"
    " + [0.2, 0.3, 0.1] * ggx(alpha_x=0.1, alpha_y=0.25, f0=0.5)"
)
SEVEN = (Part("lambert"), Part("ggx", 0.04))
SEVEN_P = np.array([0.1, 0.2, 0.4, 0.9, 0.8, 0.7, 0.3])


def scenery(parts, p, noise=0.0, loss="linear", seed=0):
    f = values(parts, p, Scenery.of(WI, WO, np.ones((LAYOUT.size, 3)), 1.0, loss, 1e-3))[0]
    f = f * (1 + noise * np.random.default_rng(seed).standard_normal(f.shape))
    return Scenery.of(WI, WO, f, np.ones_like(f), loss, 1e-3)


def test_a_sketch_is_the_model_it_is_spelled_as():
    assert "+".join(part.spelled() for part in MIXED) == (
        "lambert(rho=shared)+ggx(alpha=each, f0=0.04)+ggx(alpha_x=?, alpha_y=?, f0=?)"
    )
    f = values(MIXED, MIXED_P, scenery(SEVEN, SEVEN_P))[0]
    np.testing.assert_allclose(f, evaluate(build(MIXED_SPELLED), WI, WO), rtol=1e-12)


def test_derivatives_are_those_of_finite_differences():
    s, p = scenery(SEVEN, SEVEN_P, loss="cbrt"), MIXED_P
    rows = residuals(MIXED, p, s)[1]
    for j in range(p.size):
        step = np.eye(p.size)[j] * 1e-6
        slope = (residuals(MIXED, p + step, s)[0] - residuals(MIXED, p - step, s)[0]) / 2e-6
        np.testing.assert_allclose(rows[:, :, j], slope, rtol=1e-5, atol=1e-7)


def test_a_descent_finds_the_truth_and_stops_on_bounds():
    s = scenery(SEVEN, SEVEN_P, loss="cbrt")
    p, cost = fitted(SEVEN, np.array([0.3, 0.3, 0.3, 0.2, 0.2, 0.2, 0.6]), s)
    np.testing.assert_allclose(p, SEVEN_P, rtol=1e-6)
    assert cost < 1e-12
    bare = scenery((Part("lambert"),), np.array([0.0, 0.2, 0.4]))
    p, _ = fitted(SEVEN, SEVEN_P, bare)
    assert p[0] == 0.0 and (p[:3] <= 1).all()


def test_a_new_lobe_begins_where_the_data_put_it():
    s = scenery(SEVEN, SEVEN_P, loss="cbrt")
    start = carried((Part("lambert"),), np.array([0.3, 0.3, 0.3]), SEVEN, 3)
    assert np.isnan(start[3:]).all()
    np.testing.assert_allclose(fitted(SEVEN, start, s)[0], SEVEN_P, rtol=1e-6)


def test_held_out_readings_are_those_of_a_fit_without_them():
    """The closed form against refits: exact for a linear model, within a few per cent for a lobe's width."""
    s = scenery(SEVEN, SEVEN_P, noise=0.05)
    groups = criteria.neighbourhood(WI, WO).groups
    for parts, p, tolerance in (((Part("lambert"),), SEVEN_P[:3], 1e-6), (SEVEN, SEVEN_P, 0.05)):
        p = minimise(CandidateProblem(parts, s), [p])[0].p
        r, rows = residuals(parts, p, s)
        guess = criteria.held_out(r, rows, np.ones(p.size, bool), groups)
        for g in (0, 4, int(groups.max())):
            inside = (groups != g).astype(float)[:, None] * np.ones((1, 3))
            without = minimise(CandidateProblem(parts, s.weighted(inside)), [p])[0].p
            truth = np.sum(residuals(parts, without, s)[0][groups == g] ** 2)
            assert guess[g] == pytest.approx(truth, rel=tolerance)


def test_a_model_with_every_number_on_a_bound_predicts_what_it_is():
    r = np.random.default_rng(0).standard_normal((6, 2))
    groups = np.array([0, 0, 1, 1, 2, 2])
    held = criteria.held_out(r, np.ones((6, 2, 1)), np.zeros(1, bool), groups)
    np.testing.assert_allclose(held, [np.sum(r[groups == g] ** 2) for g in range(3)])


def test_noise_is_seen_beside_what_a_model_misses():
    """Rice's differences find 1 % noise under a smooth misfit twenty times as large; readings then count for less."""
    near, rng = criteria.neighbourhood(WI, WO), np.random.default_rng(3)
    noise, used = 0.01 * rng.standard_normal((LAYOUT.size, 3)), np.ones((LAYOUT.size, 3), bool)
    smooth = 0.2 * np.cos(2 * np.arccos(np.clip(WI.z, -1, 1)))[:, None] * np.ones((1, 3))
    size = np.ones_like(noise)
    assert np.mean(criteria.noise_deviation(noise, size, used, near)) == pytest.approx(0.01, rel=0.1)
    assert criteria.worth_of_one(noise, used, near) < 1.1
    assert np.mean(criteria.noise_deviation(smooth + noise, size, used, near)) < 0.05
    assert criteria.worth_of_one(smooth + noise, used, near) > 8
