import numpy as np
import pytest
from scipy.stats import norm, skellam

from gonio.checks.table.statistics.count_sizes import CountSizes
from gonio.checks.table.statistics.counts import difference_p, family_p, sidak
from gonio.checks.table.statistics.sum_tests import Counted, sums_p


def one(*values):
    return [np.array([float(v)]) for v in values]


@pytest.mark.parametrize(
    ("up", "down", "x"), [(0.2, 0.2, 5), (1, 1, 9), (10, 10, 22), (100, 100, 75), (1000, 1000, 250)]
)
def test_tails_of_counts_are_those_of_their_exact_distribution(up, down, x):
    p = difference_p(*one(x, 0, np.sqrt(up), np.sqrt(down), 1, 1, 0))[0]
    assert p == pytest.approx(2 * skellam.sf(x - 1, up, down), rel=0.01)


def test_tails_without_counts_are_normal():
    z = np.array([0.5, 2.4, 2.6, 8.0])
    p = difference_p(z, 0 * z, np.full(4, 0.6), np.full(4, 0.8), *np.full((2, 4), 1e-9), np.zeros(4))
    np.testing.assert_allclose(p, 2 * norm.sf(z), rtol=1e-4)


def test_no_difference_is_so_large_that_it_has_no_p_value():
    huge = np.array([50.0, 1e4, 1e12])
    p = difference_p(huge, 0 * huge, *np.ones((2, 3)), np.array([1e-6, 1.0, 1e6]), np.ones(3), np.zeros(3))
    assert np.all((p >= 0) & (p < 1e-9))


def test_a_family_has_the_level_that_was_asked():
    assert family_p(sidak(0.01, 12345), 12345) == pytest.approx(0.01)
    assert sidak(0.01, 1) == pytest.approx(0.01)


def quantum(f, u):
    """The size of a count by readings (n,) of one incidence, at each of them."""
    return CountSizes(np.zeros(f.size), 0).of((f, u)).of_readings(np.arange(f.size))


def test_the_size_of_a_count_is_found():
    rng = np.random.default_rng(0)
    expected, scale = rng.uniform(0.01, 0.5, 4000), 200.0
    f = rng.poisson(expected * scale) / scale
    noisy = np.sqrt(expected / scale + (0.1 * expected) ** 2)
    for u in (np.sqrt(expected / scale), noisy):
        assert np.median(quantum(f, u)) * scale == pytest.approx(1, abs=0.4)
    # Noise in proportion has no counts: what is found is too small to change a tail.
    q = quantum(expected, 0.02 * expected)
    assert np.max(q / (0.02 * expected)) < 0.05


@pytest.mark.parametrize(("expected", "counts"), [(1e-5, 1), (1e-3, 1), (1e-3, 2), (0.02, 1)])
def test_rare_counts_have_the_tail_of_their_law(expected, counts):
    root = np.sqrt(expected)
    p = difference_p(*one(counts, 0, root, root, 1, 1, 0))[0]
    assert p == pytest.approx(2 * skellam.sf(counts - 1, expected, expected), rel=0.06)


@pytest.mark.parametrize(("expected", "pairs"), [(1e-4, 40), (0.003, 40), (0.3, 40), (30.0, 400)])
def test_sums_of_counts_have_tails_no_lighter_than_their_law(expected, pairs):
    root, ones, nothing = (np.full(pairs, v) for v in (np.sqrt(expected), 1.0, 0.0))
    total = np.ceil(4.5 * np.sqrt(2 * pairs * expected))
    z = total / np.sqrt(2 * expected * pairs)
    readings = Counted(nothing + expected, root, ones)
    exact = 2 * skellam.sf(total - 1, pairs * expected, pairs * expected)
    (p,) = sums_p(np.array([z]), np.array([pairs]), readings, readings)
    assert 0.8 * exact <= p <= 20 * exact


@pytest.mark.parametrize("expected", [0.005, 0.1, 1.0, 30.0])
def test_the_size_of_a_count_is_not_too_small_where_few_were_met(expected):
    rng = np.random.default_rng(1)
    f = rng.poisson(expected, 3000).astype(float)
    assert np.median(quantum(f, np.full(3000, np.sqrt(expected)))) > 0.85
