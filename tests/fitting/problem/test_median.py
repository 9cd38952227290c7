"""The median of numbers that come in parts."""

import numpy as np
import pytest

from gonio.fitting.problem import median
from gonio.fitting.problem.median import median_of_parts, sorted_median


@pytest.mark.parametrize("kept", [0, 50, 1 << 20])
@pytest.mark.parametrize("seed", range(6))
def test_it_is_that_of_all_together(monkeypatch, seed, kept):
    monkeypatch.setattr(median, "KEPT", kept)
    rng = np.random.default_rng(seed)
    kinds = (
        rng.lognormal(0, 20, 301), rng.random(200), rng.integers(0, 3, 1000).astype(float), np.full(64, 0.1),
        1 + np.arange(99) * 2.0**-52, np.array([0.0, np.inf]),
    )  # fmt: skip
    parts = np.array_split(rng.permutation(kinds[seed]), 7)
    assert median_of_parts(lambda: (part.reshape(-1, 1) for part in parts)) == np.median(kinds[seed])


def test_of_nothing_there_is_none():
    assert np.isnan(median_of_parts(lambda: [np.zeros(0)]))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_of_sorted_numbers_it_is_numpys(kind):
    rng = np.random.default_rng(1)
    for numbers in (rng.random((3, 7)), rng.random(8), np.ones(1), np.array([0.0, np.inf]), np.array([1.0, np.nan])):
        assert np.array_equal(sorted_median(numbers.astype(kind)), np.median(numbers.astype(kind)), equal_nan=True)
