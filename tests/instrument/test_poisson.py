"""Counts: the distribution is Poisson's, by SciPy's probabilities; the draw depends on its key alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from gonio.instrument.noise import log_probability, poisson

pytestmark = pytest.mark.quick_compilation

N = 1 << 16


@jax.jit
def draw(seed, expected):
    keys = jax.vmap(jax.random.fold_in, (None, 0))(jax.random.key(seed), jnp.arange(N))
    return poisson(keys, expected)


@pytest.mark.parametrize("expected", [0.05, 1.0, 9.99, 10.0, 37.5, 1234.5])
def test_counts_have_poissons_probabilities(expected):
    count = np.asarray(draw(3, np.full(N, expected)))
    assert (count == np.floor(count)).all() and (count >= 0).all()
    law = stats.poisson(expected)
    # Bins of about equal probability, at least 50 counts in each.
    edges = np.unique(law.ppf(np.linspace(0, 1, 60)[1:-1]))
    probability = np.diff(np.concatenate([[0.0], law.cdf(edges), [1.0]]))
    observed = np.bincount(np.searchsorted(edges, count), minlength=edges.size + 1)
    keep = probability * N > 50
    chi2 = np.sum((observed - N * probability)[keep] ** 2 / (N * probability[keep]))
    assert stats.chi2.sf(chi2, keep.sum() - 1) > 1e-4


@pytest.mark.parametrize("expected", [1e7, 3e12])
def test_large_counts_have_poissons_moments(expected):
    z = (np.asarray(draw(4, np.full(N, expected))) - expected) / np.sqrt(expected)
    assert abs(z.mean()) < 4 / np.sqrt(N)
    assert abs(z.var() - 1) < 4 * np.sqrt(2 / N)
    assert stats.kstest(z, "norm").pvalue > 1e-4


def test_probabilities_keep_their_digits():
    expected = np.array([10.0, 10.0, 50.0, 1e4, 1e4, 1e8])[:, None]
    k = np.round(expected + np.linspace(-2.5, 2.5, 11) * np.sqrt(expected))
    np.testing.assert_allclose(log_probability(k, expected), stats.poisson.logpmf(k, expected), atol=3e-6)
    single = log_probability(k.astype(np.float32), expected.astype(np.float32))
    np.testing.assert_allclose(single, stats.poisson.logpmf(k, expected), atol=2e-4)


def test_a_draw_depends_on_its_key_alone():
    mixed = 10 ** np.random.default_rng(0).uniform(-2, 6, N)
    count = np.asarray(draw(5, mixed))
    other = np.where(np.arange(N) % 7 == 3, mixed, 1e3)
    np.testing.assert_array_equal(np.asarray(draw(5, other))[3::7], count[3::7])


def test_nothing_gives_nothing():
    count = np.asarray(draw(6, np.resize([0.0, -1.0, np.nan, np.inf], N)))
    assert not count.any()
