"""H of isotropic scattering: its nonlinear integral equation, moments, a known value, single precision, slopes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.volume_scatter.chandrasekhar_h import absorption_root, h_isotropic

W = [0.0, 0.01, 0.5, 0.9, 0.999, 1 - 1e-8, 1 - 1e-14, 1.0]
MU = np.array([1e-12, 1e-6, 1e-3, 0.1, 0.5, 1.0])

h_table = jax.jit(jax.vmap(h_isotropic, in_axes=(0, None)))


def nodes():
    # Substitution μ = v³: H has a μ ln μ at 0.
    x, weight = np.polynomial.legendre.leggauss(200)
    v = (x + 1) / 2
    return v**3, weight / 2 * 3 * v**2


def test_the_integral_equation():
    """H(μ) = 1 + (w/2) μ H(μ) ∫ H(μ')/(μ + μ') dμ' [Chandrasekhar 1960, ch. V], and its moments of order 0 and 1."""
    mu_q, weight = nodes()
    h_q = np.asarray(h_table(jnp.asarray(mu_q), jnp.asarray(W)))
    mu = np.array([0.05, 0.3, 1.0])
    h = np.asarray(h_table(jnp.asarray(mu), jnp.asarray(W)))
    integral = np.einsum("q,qw,mq->mw", weight, h_q, 1 / (mu[:, None] + mu_q))
    np.testing.assert_allclose(h, 1 + np.asarray(W) / 2 * mu[:, None] * h * integral, rtol=1e-12)
    w = np.asarray(W[1:])
    np.testing.assert_allclose(weight @ h_q[:, 1:], 2 / (1 + np.sqrt(1 - w)), rtol=1e-12)
    assert (weight * mu_q) @ h_q[:, -1] == pytest.approx(2 / np.sqrt(3), rel=1e-12)


def test_known_values():
    found = np.asarray(h_table(jnp.asarray(MU), jnp.asarray(W)))
    assert found[-1, -1] == pytest.approx(2.907810529078606, rel=1e-14)  # at μ = w = 1
    assert np.all(found[:, 0] == 1.0)


@pytest.mark.parametrize("w", [0.3, 0.9999, 1.0])
def test_against_thirty_digits(w):
    mp = pytest.importorskip("mpmath")
    with mp.workdps(60):

        def integrand(s, mu):
            t = mp.exp(s)
            return mp.log(1 - mp.mpf(w) * mp.atan(t) / t) * mu * t / (1 + (mu * t) ** 2)

        step = mp.mpf("0.2")  # the trapezoidal rule's error is exp(−π²/step)
        for mu in (1e-4, 0.3):
            total = mp.fsum(integrand(step * j, mp.mpf(mu)) for j in range(-250, 350))
            exact = float(mp.exp(-step * total / mp.pi))
            assert float(h_table(jnp.asarray([mu]), jnp.asarray(w))[0]) == pytest.approx(exact, rel=1e-13)


def test_single_precision():
    mu, w = jnp.asarray(MU), jnp.asarray(W[:5])
    single = h_table(mu.astype(jnp.float32), w.astype(jnp.float32))
    assert single.dtype == jnp.float32
    exact = h_table(mu.astype(jnp.float32).astype(float), w.astype(jnp.float32).astype(float))
    np.testing.assert_allclose(single, exact, rtol=6e-7)


def test_slopes():
    """Central differences inside; at the ends the slopes are finite, where that by w is −∞ in truth."""
    slope = jax.jit(jax.grad(h_isotropic, argnums=(0, 1)))
    step = 1e-5
    for mu, w in ((0.4, 0.7), (1e-2, 0.99)):
        found = slope(jnp.asarray(mu), jnp.asarray(w))
        h = h_table(jnp.asarray([mu - step, mu + step, mu]), jnp.asarray([w - step, w, w + step]))
        np.testing.assert_allclose(
            found, [(h[1, 1] - h[0, 1]) / (2 * step), (h[2, 2] - h[2, 0]) / (2 * step)], rtol=1e-5
        )
    for mu in (1e-300, 1e-8, 1.0):
        for w in (0.0, 1.0):
            assert np.all(np.isfinite(slope(jnp.asarray(mu), jnp.asarray(w))))


def test_the_root_of_no_absorption():
    assert absorption_root(jnp.asarray(1.0)) < 2e-16
    assert absorption_root(jnp.asarray(0.0)) == 1.0
    w = 1 - 2.0**-53
    assert absorption_root(jnp.asarray(w)) == pytest.approx(2.0**-26.5, rel=1e-15)
