"""Roots of increasing functions, beside those of SciPy and in closed form."""

import numpy as np
from scipy.optimize import brentq

from gonio.checks.table.statistics.bracketed_root import bracketed_root


def test_roots_are_those_of_closed_forms_to_the_last_digits():
    y = np.logspace(-12, 12, 97)
    root = bracketed_root(lambda t, y: t**3 - y, np.zeros(97), np.full(97, 1e5), (y,))
    np.testing.assert_allclose(root, np.cbrt(y), rtol=4e-16)


def test_steep_and_flat_functions_have_the_roots_that_another_solver_finds():
    rng = np.random.default_rng(3)
    a, x = rng.uniform(0.01, 50, 40), rng.exponential(5, 40)
    root = bracketed_root(lambda t, a, x: np.expm1(a * t) + t / 7 - x, np.zeros(40), np.full(40, 10.0), (a, x))
    expected = [
        brentq(lambda t, i=i: np.expm1(a[i] * t) + t / 7 - x[i], 0, 10, xtol=1e-300, rtol=1e-15) for i in range(40)
    ]
    np.testing.assert_allclose(root, expected, rtol=1e-14)


def test_where_nothing_crosses_zero_the_upper_end_stands():
    root = bracketed_root(lambda t, y: t - y, np.zeros(3), np.full(3, 2.0), (np.array([1.0, 2.0, 5.0]),))
    np.testing.assert_array_equal(root, [1, 2, 2])
