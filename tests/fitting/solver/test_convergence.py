"""Fits in the caller's precision: single precision converges where it can, and says how far that is."""

import jax
import numpy as np
import pytest

from gonio.fitting.fit_table import fit
from gonio.fitting.solver.lm_step import EXACT, STATIONARY, is_exact, stationary_limit
from support.fit_tables import free, table_of

TRUTH = "lambert(rho=0.2) + 0.5*ggx(alpha=0.3, f0=0.6)"


def test_single_precision_converges_to_what_double_finds():
    table = table_of(TRUTH, noise=0.02)
    double = fit(table, "lambert + ggx", starts=2)
    with jax.enable_x64(False):
        single = fit(table, "lambert + ggx", starts=2)
    assert double.converged and double.reason == "stationary" and double.starts_agreed == double.starts
    assert single.converged and "single precision" in single.reason and single.starts_agreed == single.starts
    for name, p in free(double).items():
        assert free(single)[name].value == pytest.approx(p.value, abs=0.02 * p.standard_uncertainty)
        assert free(single)[name].standard_uncertainty == pytest.approx(p.standard_uncertainty, rel=1e-3)


def test_the_limits_follow_the_precision():
    cost, target_norm_squared = 0.5e-4, 1.0  # a residual of 1 % of the data
    assert stationary_limit(cost, target_norm_squared) == STATIONARY
    assert is_exact(0.5 * (0.9 * EXACT * np.finfo(float).eps) ** 2, 1.0) and not is_exact(1e-20, 1.0)
    with jax.enable_x64(False):
        assert STATIONARY < stationary_limit(cost, target_norm_squared) < 1e-3
        assert stationary_limit(1e-30, target_norm_squared) == 1e-3
        assert is_exact(1e-20, 1.0)
