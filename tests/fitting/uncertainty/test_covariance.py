"""Covariances with bounds."""

import numpy as np

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
