"""Criteria of a selection: noise beside misfit, design effect, cross-validation."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.fitting.selection.criteria import (
    Neighbourhood,
    design_effect,
    holdout_chi2,
    improves_holdout,
    neighbourhood,
    noise_deviation,
)

THETA = np.radians(np.arange(0, 81, 20.0))
WI, WO = layouts.spherical(
    THETA, np.radians([0, 60, 120.0]), THETA, np.radians(np.arange(0, 360, 40.0))
).directions()  # fmt: skip
SHAPE = (WI.z.size, 3)


def test_a_model_with_every_number_on_a_bound_predicts_what_it_is():
    r = np.random.default_rng(0).standard_normal((6, 2))
    groups = np.array([0, 0, 1, 1, 2, 2])
    chi2 = holdout_chi2(r, np.empty((6, 2, 0)), groups)
    np.testing.assert_allclose(chi2, [np.sum(r[groups == g] ** 2) for g in range(3)])


def test_noise_shows_beside_what_a_model_misses():
    """Rice's differences find 1 % noise under a smooth misfit twenty times as large, which correlates the residuals."""
    near, noise = neighbourhood(WI, WO), 0.01 * np.random.default_rng(3).standard_normal(SHAPE)
    size, used = np.ones(SHAPE), np.ones(SHAPE, bool)
    smooth = 0.2 * np.cos(2 * np.arccos(np.clip(WI.z, -1, 1)))[:, None] * size
    # A variance from as many differences of χ²₁ as there are pairs, in bins: four standard errors of all.
    tolerance = 4 / np.sqrt(2 * near.pairs.shape[0])
    assert np.mean(noise_deviation(noise, size, used, near)) == pytest.approx(0.01, rel=tolerance)
    assert design_effect(noise, used, near) == 1.0
    assert np.mean(noise_deviation(smooth + noise, size, used, near)) < 0.2 / 4
    assert design_effect(smooth + noise, used, near) > 8


def test_a_gain_within_its_standard_error_is_none():
    small = np.array([10.0, 10.0, 10.0, 10.0])
    assert improves_holdout(small, small - [1.0, 1.0, 1.0, 1.1])
    assert not improves_holdout(small, small - [5.0, -4.0, 3.0, -2.0])
    assert not improves_holdout(small[:1], small[:1] - 5)


def test_the_order_of_the_readings_does_not_choose_among_equally_near_ones():
    oblique = THETA[1:]  # at a pole more readings than are looked at are in one place
    directions = layouts.spherical(
        oblique, np.radians([0, 60, 120.0]), oblique, np.radians([0, 90, 180.0])
    ).directions()
    rng = np.random.default_rng(4)
    shape = (directions[0].z.size, 3)
    f, sizes = rng.standard_normal(shape), (np.ones(shape), rng.uniform(1, 2, shape))
    for size in sizes:
        levels = []
        for seed in range(3):
            k = np.random.default_rng(seed).permutation(shape[0])
            wi, wo = (type(w)(*(np.asarray(c)[k] for c in w)) for w in directions)
            levels.append(noise_deviation(f[k], size[k], np.ones(shape, bool), neighbourhood(wi, wo)).mean())
        np.testing.assert_allclose(levels, levels[0], rtol=1e-12)


def test_the_noise_of_dark_readings_is_their_own_however_bright_the_highlight():
    size, noise = (np.repeat(a, [1600, 1600, 800])[:, None] for a in ([0.1, 0.4, 1e6], [0.01, 0.1, 1e4]))
    every = np.arange(size.size)
    near = Neighbourhood(every.reshape(-1, 2), every // 8, every)
    residual = noise * np.random.default_rng(6).standard_normal(size.shape)
    levels = noise_deviation(residual, size, np.ones(size.shape, bool), near)
    # Each level from at least 400 differences: four standard errors.
    np.testing.assert_allclose(levels, noise, rtol=4 / np.sqrt(2 * 400))
