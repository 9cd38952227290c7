"""Averages over discs inside a fit's program, against midpoint rules in polar coordinates about the discs' axes."""

import dataclasses
import itertools

import jax
import numpy as np
import pytest

from gonio.fitting.problem.disc_averages import CUT, KINDS, OPPOSED, STEPS, Lanes, steps_of
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import Readings, block_of
from gonio.models.expression.parser import parse, with_defaults
from gonio.models.geometry.directions import Direction, from_spherical

MODEL = "lambert + ggx(f0=0.04)"
P = np.array([0.1, 0.15, 1.0])
DEGREE = np.pi / 180


def readings(theta_i: np.ndarray, theta_o: np.ndarray, phi: np.ndarray, half_angles: tuple[float, float]) -> Readings:
    wi, wo = (
        Direction(*map(np.asarray, from_spherical(t, a))) for t, a in ((theta_i, 0.3 + 0 * phi), (theta_o, phi + 0.3))
    )
    one = np.ones((theta_i.size, 1))
    return Readings(wi, wo, one, one, one > 0, half_angles=half_angles)


def problem_of(part: Readings, model: str = MODEL) -> FitProblem:
    s, fixed, _ = parameters(with_defaults(parse(model)), 1)
    return FitProblem.create(s, fixed, "linear", part, np.ones((part.f.shape[0], 1)), 1.0)


def cap(w: np.ndarray, half_angle: float, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (3, m) and weights cosθ dω of a cap about w."""
    if not half_angle:
        return w[:, None], np.ones(1)
    t = np.cross(w, [0.0, 0.6, 0.8])
    t /= np.linalg.norm(t)
    b = np.cross(w, t)
    height = 1.0 - (1.0 - np.cos(half_angle)) * (np.arange(rings) + 0.5) / rings  # even in solid angle
    azimuth = 2 * np.pi * (np.arange(4 * rings) + 0.5) / (4 * rings)
    c, a = (g.ravel() for g in np.meshgrid(height, azimuth, indexing="ij"))
    rays = w[:, None] * c + np.sqrt(1 - c * c) * (t[:, None] * np.cos(a) + b[:, None] * np.sin(a))
    return rays, np.maximum(rays[2], 0.0)


def averaged_by_midpoints(problem: FitProblem, k: int, rings: int) -> float:
    r = problem.readings
    axes = (np.array([np.asarray(c)[k] for c in w]) for w in (r.wi, r.wo))
    (ray_i, of_i), (ray_o, of_o) = (cap(w, s, rings) for w, s in zip(axes, r.half_angles, strict=True))
    pairs = [np.repeat(ray_i, of_o.size, axis=1), np.tile(ray_o, of_i.size)]
    weight = np.outer(of_i, of_o).ravel()
    up = weight > 0
    f = problem.values_at(P, *(Direction(*w[:, up]) for w in pairs))[:, 0]
    return float(np.sum(f * weight[up]) / np.sum(weight))


@pytest.mark.parametrize(
    ("half_angles", "rings"), [((0.0, 2 * DEGREE), 120), ((2 * DEGREE, 0.0), 120), ((DEGREE, DEGREE), 12)]
)
def test_averages_are_those_of_a_finer_rule(half_angles: tuple[float, float], rings: int):
    """In the highlight, beside it, and where the horizon cuts a disc, which takes rules of its own."""
    theta_i, theta_o = np.radians([30.0, 30.0, 60.0, 5.0, 89.0]), np.radians([30.0, 36.0, 65.0, 50.0, 80.0])
    problem = problem_of(readings(theta_i, theta_o, np.array([np.pi, 3.0, np.pi, 0.5, 3.1]), half_angles))
    exact = [averaged_by_midpoints(problem, k, rings) for k in range(5)]
    cut = np.array([0, 0, 0, 0, CUT])
    finest = np.array(steps_of(half_angles))[cut] - 1
    values = problem.averaged(KINDS * finest + cut).model_values(P)[:, 0]
    np.testing.assert_allclose(values, exact, rtol=2e-3 if rings < 100 else 1e-4)
    centres = problem.model_values(P)[:, 0]
    errors = [np.abs(problem.averaged(KINDS * step + cut).model_values(P)[:, 0] / values - 1)[:3] for step in (1, 2, 3)]
    errors = [np.abs(centres / values - 1)[:3], *errors]
    assert all((finer < 0.5 * coarser).all() for coarser, finer in itertools.pairwise(errors))


def test_a_reading_is_the_same_whatever_stands_beside_it():
    """Few readings of a fine rule share lanes: value, sum and slopes are those of each by itself; points keep bits."""
    rng = np.random.default_rng(0)
    n = 600
    part = readings(rng.uniform(0, 1.5, n), rng.uniform(0, 1.5, n), rng.uniform(0, 6, n), (0.02, 0.03))
    problem = problem_of(part)
    kinds = [KINDS * step + kind for step in (1, 2) for kind in range(KINDS)]
    rules = np.where(rng.random(n) < 0.03, rng.choice(kinds, n), 0)
    mixed, alone = problem.averaged(rules), [problem.averaged(np.full(n, rule)) for rule in kinds]
    values = mixed.model_values(P)
    np.testing.assert_allclose(values[rules == 0], problem.model_values(P)[rules == 0], rtol=1e-14)
    for rule, other in zip(kinds, alone, strict=True):
        np.testing.assert_allclose(values[rules == rule], other.model_values(P)[rules == rule], rtol=1e-12)
    some = rng.permutation(n)[:200]
    total = mixed.normal_equations(P[None])
    parts = [mixed.subset(np.sort(c)).normal_equations(P[None]) for c in (some, np.setdiff1d(np.arange(n), some))]
    np.testing.assert_allclose(total.cost, sum(e.cost for e in parts), rtol=1e-12)
    np.testing.assert_allclose(total.gradient, sum(e.gradient for e in parts), rtol=1e-9)
    step = 1e-6 * np.eye(3)
    costs = mixed.normal_equations(np.concatenate([P + step, P - step])).cost
    np.testing.assert_allclose((costs[:3] - costs[3:]) / 2e-6, total.gradient[0][np.argsort(mixed.order)], rtol=1e-5)


def test_averages_serve_problems_of_other_targets_and_weights():
    """Sums and values at numbers where a like problem was averaged before: those of a problem of its own."""
    rng = np.random.default_rng(3)
    n = 300
    part = readings(rng.uniform(0, 1.4, n), rng.uniform(0, 1.4, n), rng.uniform(0, 6, n), (0.02, 0.03))
    rules = rng.choice([0, KINDS, 2 * KINDS, 3 * KINDS + OPPOSED], n)
    target, weight = rng.random((n, 1)), rng.random((n, 1))
    averaged = problem_of(part).averaged(rules)
    averaged.normal_equations(P[None])
    like = averaged.retargeted(target).reweighted(weight)
    own = problem_of(part).retargeted(target).reweighted(weight).averaged(rules)
    for p in (P, 1.1 * P, P):
        for a, b in zip(*(jax.tree.leaves(q.normal_equations(p[None])) for q in (like, own)), strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(like.model_values(p), own.model_values(p))
    others = like.averaged(np.full(n, KINDS))
    np.testing.assert_array_equal(others.model_values(P), averaged.averaged(np.full(n, KINDS)).model_values(P))
    np.testing.assert_array_equal(like.subset(np.arange(50)).model_values(P), own.model_values(P)[:50])


@pytest.mark.parametrize(("model", "channels"), [(MODEL, 1), ("lambert + ggx(alpha~[0.2, 0.3], f0=0.04)", 2)])
def test_values_near_are_those_of_the_step_to_first_order(model: str, channels: int):
    """What is off falls with the square of the step; of albedos and scales alone nothing is off."""
    rng = np.random.default_rng(4)
    n = 200
    part = readings(rng.uniform(0, 1.2, n), rng.uniform(0, 1.2, n), rng.uniform(2, 4, n), (0.03, 0.02))
    s, fixed, _ = parameters(with_defaults(parse(model)), channels)
    part = dataclasses.replace(part, **{name: np.ones((n, channels)) > 0 for name in ("f", "u_f", "valid")})
    problem = FitProblem.create(s, fixed, "linear", part, np.ones((n, channels)), 1.0).averaged(np.full(n, 2 * KINDS))
    p, way = rng.uniform(0.1, 0.3, s.size), rng.uniform(0.5, 1.0, s.size)
    off = [np.abs(problem.values_near(p, h * way) - problem.model_values(p + h * way)).max() for h in (1e-3, 1e-4)]
    moved = np.abs(problem.model_values(p + 1e-3 * way) - problem.model_values(p)).max()
    assert off[0] < 0.03 * moved and off[1] < 0.015 * off[0]
    linear = 0.1 * s.linear
    np.testing.assert_allclose(problem.values_near(p, linear), problem.model_values(p + linear), rtol=1e-13)


def test_every_reading_has_its_lane():
    rng = np.random.default_rng(1)
    rules = rng.integers(0, KINDS * len(STEPS), 3000)
    lanes = Lanes.of(rules, (0.0, 0.1), block_of(1))
    np.testing.assert_array_equal(lanes.source[lanes.place], np.arange(3000))
    np.testing.assert_array_equal(lanes.blocks.rule[lanes.place // block_of(1)], rules)
    served = np.bincount(lanes.source[lanes.source >= 0], minlength=3000)
    np.testing.assert_array_equal(served, 1 << lanes.blocks.halvings[lanes.place // block_of(1)])


@pytest.mark.parametrize(("model", "narrow_in"), [(MODEL, 0), ("lambert + retro(f0=0.04)", OPPOSED)])
def test_rules_of_pairs_are_fine_where_a_lobe_is_narrow(model: str, narrow_in: int):
    """About the mirror direction and about the light, between equal and unequal discs: both kinds end at one value."""
    rng = np.random.default_rng(2)
    theta, away = np.radians(rng.uniform(5, 60, 40)), rng.normal(0, 0.03, (2, 40))
    phi = away[0] + (np.pi if narrow_in == 0 else 0.0)
    for half_angles in ((2 * DEGREE, 2 * DEGREE), (2 * DEGREE, 0.7 * DEGREE)):
        problem = problem_of(readings(theta, np.abs(theta + away[1]), phi, half_angles), model)
        whole, opposed = (
            [problem.averaged(np.full(40, KINDS * step + kind)).model_values(P) for step in (4, 5, 8)]
            for kind in (0, OPPOSED)
        )
        fine, coarse = (whole, opposed) if narrow_in == 0 else (opposed, whole)
        exact = fine[-1]
        np.testing.assert_allclose(fine[0], exact, rtol=3e-4)
        np.testing.assert_allclose(fine[1], exact, rtol=3e-5)
        assert np.abs(fine[1] / exact - 1).max() < np.abs(coarse[1] / exact - 1).max()
