"""Quantiles and orders: those of NumPy, without what is missing."""

import numpy as np
import pytest

from gonio.checks.table.statistics.quantiles import median, quantiles, stable_order


@pytest.mark.parametrize("size", [1, 2, 3, 100, 101])
@pytest.mark.parametrize("kind", [float, np.float32])
def test_quantiles_are_those_of_numpy_without_what_is_missing(size, kind):
    values = np.random.default_rng(size).standard_normal((size, 3)).astype(kind)
    values[::4, 1] = np.nan
    before, shares = values.copy(), (0.0, 0.3, 0.5, 0.95, 1.0)
    expected = [np.nanpercentile(values.astype(float), 100 * share) for share in shares]
    assert quantiles(values, *shares) == pytest.approx(expected, rel=1e-12)
    np.testing.assert_array_equal(values, before)


def test_of_nothing_known_there_is_no_median():
    assert np.isnan(median(np.full(4, np.nan))) and median(np.array([np.inf, np.inf])) == np.inf


@pytest.mark.parametrize("different", [1, 5, 1000])
def test_the_order_is_stable(different):
    values = np.random.default_rng(different).integers(0, different, 1000) / 7
    np.testing.assert_array_equal(stable_order(values), np.argsort(values, kind="stable"))
    np.testing.assert_array_equal(stable_order(values[:0]), np.zeros(0, int))
