"""Covariances with bounds."""

import numpy as np
import pytest

from gonio.fitting.problem.parameterisation import LINEAR, Domains
from gonio.fitting.uncertainty.covariance import CovarianceEstimate, at_bounds_covariance


def test_a_number_on_its_bound_that_rounding_sees_as_free_leaves_those_open_that_go_with_it():
    """s·f of readings that know the product alone, f at 1: s is known if f is held there, and is not."""
    s, f, c = 0.02, 1.0, np.linspace(0, 1e-9, 50)
    rows = np.stack([f + (1 - f) * c, s * (1 - c)], axis=1) / 1e-3
    domains = Domains(np.array([LINEAR, LINEAR]), np.zeros(2), np.array([1e3, 1.0]))
    estimate = CovarianceEstimate(rows.T @ rows, None, 50, domains, np.array([s, f]))
    held = np.array([False, True])
    assert not estimate.covariance(~held).undetermined[0]
    bounded = at_bounds_covariance(estimate, np.zeros(2), held, np.zeros(2, bool))
    assert bounded.covariance.undetermined.all() and not bounded.active_bound.any()
    ((variance, change),) = bounded.covariance.combinations
    assert np.isinf(variance) and np.isclose(change[0] / change[1], -s / f)


@pytest.mark.parametrize("noise_known", [True, False])
def test_a_variance_too_large_for_a_number_is_not_known_and_leaves_the_others(noise_known):
    c = np.linspace(-1, 1, 50)
    rows = np.stack([1 + c, 1e-159 * (1 - c)], axis=1) / 1e-3
    domains = Domains(np.array([LINEAR, LINEAR]), np.zeros(2), np.array([1e3, 1.0]))
    scores = None if noise_known else rows.T @ rows
    covariance = CovarianceEstimate(rows.T @ rows, scores, 50, domains, np.array([1.0, 0.5])).covariance(
        np.ones(2, bool)
    )
    assert list(covariance.undetermined) == [False, True]
    np.testing.assert_allclose(
        covariance.matrix[0, 0], np.linalg.inv(rows.T @ (rows * [1, 1e159]) * [[1], [1e159]])[0, 0], rtol=0.1
    )


@pytest.mark.parametrize("noise_known", [True, False])
@pytest.mark.parametrize("small", [0.5, 0.05, 0.005])
def test_what_an_open_combination_carries_by_much_more_than_its_uncertainty_is_open_with_it(noise_known, small):
    """s·(a x + b y)ⁿ of readings that know the products alone, by logarithms: a is known if s is, and is not, however
    little it is beside b."""
    n, x, y = 6.0, *np.random.default_rng(0).random((2, 200))
    s, a, b = 1.0, small, 1.0
    rows = np.stack([np.full(x.size, 1 / s), n * x / (a * x + b * y), n * y / (a * x + b * y)], axis=1) / 1e-4
    domains = Domains(np.array([LINEAR] * 3), np.array([0.0, -10.0, -10.0]), np.array([1e3, 10.0, 10.0]))
    scores = None if noise_known else rows.T @ rows
    covariance = CovarianceEstimate(rows.T @ rows, scores, 200, domains, np.array([s, a, b])).covariance(
        np.ones(3, bool)
    )
    assert covariance.undetermined.all()
    ((variance, change),) = covariance.combinations
    np.testing.assert_allclose(change / change[0], [1.0, -a / n, -b / n], rtol=1e-3)
    assert np.isinf(variance)


@pytest.mark.parametrize("size", [2, 4, 7])
def test_without_a_scatter_nothing_is_known(size):
    """As many numbers as readings: no residual tells of noise, whatever the linear algebra makes of that."""
    domains = Domains(np.full(size, LINEAR), np.zeros(size), np.ones(size))
    estimate = CovarianceEstimate(np.eye(size), np.full((size, size), np.nan), size, domains, np.full(size, 0.5))
    covariance = estimate.covariance(np.ones(size, bool))
    assert covariance.undetermined.all() and np.isnan(covariance.standard).all()
