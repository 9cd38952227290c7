"""The exact standard reflects 1 at every incidence, and is reciprocal."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from gonio.models.diffuse.white_standard import MISSING, WhiteStandard, lost
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

MU = np.array([1.0, 0.999, 0.9, 0.5, 0.2, 0.05, 1e-3, 1e-6, 1e-9])


def test_albedo_is_one_at_every_incidence():
    x, w = leggauss(32)  # NumPy's weights of order 64 are good to 2e-15 only
    u2, weight = (np.arange(2)[:, None] + 0.5 + 0.5 * x).ravel() / 2, np.tile(w, 2) / 4

    @jax.jit
    @jax.vmap
    def albedo(wi):
        def node(v):
            wo, jacobian = WhiteStandard().lobe_map(wi, 0.3, v)
            return WhiteStandard().f(wi, wo) * wo.z * jacobian

        return jnp.sum(weight * jax.vmap(node)(u2))

    wi = Direction(jnp.asarray(np.sqrt((1 - MU) * (1 + MU))), jnp.zeros(MU.size), jnp.asarray(MU))
    found = np.asarray(albedo(wi))
    np.testing.assert_allclose(found[MU >= 1e-3], 1.0, atol=5e-15)
    np.testing.assert_allclose(found, 1.0, atol=2e-14)


def test_what_is_lost_is_precise_at_grazing_and_normal():
    mp = pytest.importorskip("mpmath")
    for mu in (1.0, 0.3, 1e-8, 1e-300):
        with mp.workdps(40):
            exact = float(mp.mpf(mu) * mp.log1p(1 / mp.mpf(mu)))
        assert lost(mu) == pytest.approx(exact, rel=1e-14)
    assert pytest.approx(1 - 4 / 3 * (1 - np.log(2)), rel=1e-14) == MISSING


def test_reciprocity_to_the_last_bit_and_zero_below_the_horizon():
    rng = np.random.default_rng(0)
    wi, wo = (
        from_spherical(jnp.asarray(rng.uniform(0, 2, 500)), jnp.asarray(rng.uniform(0, 7, 500))) for _ in range(2)
    )
    values = np.asarray(evaluate(WhiteStandard(), wi, wo))
    assert np.array_equal(values, evaluate(WhiteStandard(), wo, wi))
    assert np.all((values > 0) == ((np.asarray(wi.z) > 0) & (np.asarray(wo.z) > 0)))


def test_gradients_are_finite_at_every_edge():
    z = jnp.asarray([1.0, 1e-9, 0.0, -0.1])
    a, b = (g.ravel() for g in jnp.meshgrid(z, z))
    zero = jnp.zeros(a.size)
    wi, wo = Direction(jnp.sqrt(1 - a**2), zero, a), Direction(zero, jnp.sqrt(1 - b**2), b)
    grad = jax.jit(jax.vmap(jax.grad(WhiteStandard().f, argnums=(0, 1))))(wi, wo)
    assert all(np.all(np.isfinite(g)) for g in jax.tree.leaves(grad))
