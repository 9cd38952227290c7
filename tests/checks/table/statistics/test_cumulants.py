"""Tilts of sums of counts, beside another solver and a closed form."""

import numpy as np
from scipy.optimize import brentq

from gonio.checks.table.statistics.cumulants import Generating, tilts


def test_tilts_of_counts_of_one_size_have_a_closed_form():
    x, q = np.logspace(-6, 3, 40), np.full(40, 0.7)
    v = np.stack([np.ones(40), *np.zeros((3, 40))])
    t = tilts(Generating(np.ones(40, int), v, np.stack([q, -q, q, -q])), x)
    np.testing.assert_allclose(t, np.log1p(q * x) / q, rtol=1e-12)


def test_sums_of_unlike_counts_have_the_tilts_that_another_solver_finds():
    rng = np.random.default_rng(3)
    sizes = rng.integers(1, 30, 60)
    v, (up, down) = rng.exponential(1, (4, sizes.sum())), 10 ** rng.uniform(-3, 1, (2, sizes.sum()))
    q = np.stack([up, -up, down, -down])
    x = rng.exponential(20, 60)
    whole, starts = Generating(sizes, v, q), np.cumsum(sizes) - sizes
    t = tilts(whole, x)
    for k, (start, size) in enumerate(zip(starts, sizes, strict=True)):
        own_v, own_q = v[:, start : start + size], q[:, start : start + size]

        def slope(t, v=own_v, q=own_q, x=x[k]):
            return np.sum(v * np.expm1(q * t) / q) - x

        np.testing.assert_allclose(t[k], brentq(slope, 0, 600 / own_q.max(), xtol=1e-300, rtol=1e-14), rtol=1e-9)


def test_where_no_tilt_reaches_the_mean_the_largest_stands():
    q = np.full(1, 0.5)
    v = np.stack([np.zeros(1), np.ones(1), np.zeros(1), np.zeros(1)])
    t = tilts(Generating(np.ones(1, int), v, np.stack([q, -q, q, -q])), np.array([3.0]))  # a fall of at most 2
    np.testing.assert_allclose(t, 1200.0, rtol=1e-8)
