"""The map between unconstrained coordinates and closed domains."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.fitting.problem.parameterisation import (
    LINEAR,
    LOG,
    LOG1P,
    Domains,
    near_origin,
    parameters,
    to_parameters,
    to_unconstrained,
)
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from gonio.models.expression.parser import parse, with_defaults

D = Domains(np.array([LINEAR, LOG, LOG1P]), np.array([0.0, 1e-4, 0.0]), np.array([1.0, 1.0, 1e6]))


@settings(max_examples=80, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
def test_every_coordinate_is_inside_the_domain(x):
    p, slope, curvature = (np.asarray(a) for a in to_parameters(D, jnp.asarray(x)))
    assert np.all((p >= D.low) & (p <= D.high)) and np.all(np.isfinite(slope)) and np.all(np.isfinite(curvature))


def test_both_bounds_are_reached_at_finite_coordinates():
    np.testing.assert_allclose(to_parameters(D, jnp.zeros(3))[0], D.low, rtol=1e-14)
    np.testing.assert_allclose(to_parameters(D, jnp.full(3, np.pi / 2))[0], D.high, rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.floats(1.001e3, 1e6) | st.floats(1e6, 1e18), st.sampled_from([-1.0, 1.0]))
def test_whole_periods_away_a_coordinate_is_that_of_the_same_parameter(size, sign):
    x = near_origin(np.full(3, sign * size), np)
    assert np.all(np.abs(x) <= 2.0) and np.array_equal(near_origin(x, np), x)
    far, near = to_parameters(D, np.full(3, sign * size), np), to_parameters(D, x, np)
    assert all(np.array_equal(a, b) for a, b in zip(far, near, strict=True))
    if size < 1e6:
        np.testing.assert_allclose(np.sin(x) ** 2, np.sin(size) ** 2, rtol=0, atol=1e-12)


def test_there_and_back():
    p = np.array([0.3, 0.02, 150.0])
    np.testing.assert_allclose(to_parameters(D, jnp.asarray(to_unconstrained(D, p)))[0], p, rtol=1e-12)


def test_slope_and_curvature_are_the_derivatives():
    x = jnp.array([0.7, 1.1, 0.4])
    _, slope, curvature = to_parameters(D, x)
    for k in range(3):
        one = lambda t, k=k: to_parameters(D, x.at[k].set(t))[0][k]  # noqa: E731
        np.testing.assert_allclose(slope[k], jax.grad(one)(x[k]), rtol=1e-12)
        np.testing.assert_allclose(curvature[k], jax.grad(jax.grad(one))(x[k]), rtol=1e-10)


def test_in_single_precision_domains_and_numbers_are_what_it_holds():
    """Published rates of `sgd` reach 1e109; of JAX in single precision only smaller ones are tried or taken."""
    with jax.enable_x64(False):
        domains = parameters(with_defaults(parse("sgd")), 1).parameterisation.domains
        assert np.isfinite(domains.high.astype(np.float32)).all() and (domains.low < domains.high).all()
        for take in (build, lambda e: parameters(with_defaults(parse(e)), 1)):
            with pytest.raises(GonioError, match="1e\\+109 is more than single precision holds"):
                take("sgd(alpha=0.1, p=1, kappa=1, f0=0, f1=0, lam=1, c=1e109, k=1, theta_0=0)")
    assert parameters(with_defaults(parse("sgd")), 1).parameterisation.domains.high.max() == 1e120
