"""The azimuth map covers the circle once, with the Jacobian it states, at every incidence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.geometry.directions import from_spherical
from gonio.models.warps.grazing_azimuth import grazing_azimuth, grazing_tangent

many = jax.jit(jax.vmap(grazing_azimuth, in_axes=(None, 0)))
TANGENTS = [0.0, 1e-9, 0.3, 5.0, 1e3, 1e8, jnp.inf]


@pytest.mark.parametrize("tan_i", TANGENTS)
def test_azimuths_stand_at_the_quarters(tan_i):
    cos_psi, sin_psi, _ = many(jnp.asarray(tan_i), jnp.asarray([0.0, 0.25, 0.5, 0.75, 1.0]))
    assert cos_psi == pytest.approx([-1, 0, 1, 0, -1], abs=3e-15)
    assert sin_psi == pytest.approx([0, 1, 0, -1, 0], abs=3e-15)


@pytest.mark.parametrize("tan_i", TANGENTS)
def test_the_jacobian_sums_to_the_circle(tan_i):
    u1 = (np.arange(1000) + 0.5) / 1000
    _, _, jacobian = many(jnp.asarray(tan_i), jnp.asarray(u1))
    assert np.mean(jacobian) == pytest.approx(2 * np.pi, rel=1e-12)


def test_the_jacobian_is_the_derivative():
    u1 = jnp.linspace(0.01, 0.99, 37)
    h = 1e-6
    for tan_i in (0.0, 2.0, 300.0):
        _, _, jacobian = many(jnp.asarray(tan_i), u1)
        c1, s1, _ = many(jnp.asarray(tan_i), u1 - h)
        c2, s2, _ = many(jnp.asarray(tan_i), u1 + h)
        turned = np.arcsin(s1 * c2 - c1 * s2) / (2 * h)
        np.testing.assert_allclose(turned, jacobian, rtol=1e-6)


def test_resolves_a_horizon_at_grazing():
    # ∫ dψ sqrt(ε² + cos²ψ) over the circle is 4 sqrt(1+ε²) E(m), m = 1/(1+ε²): SciPy's elliptic integral.
    special = pytest.importorskip("scipy.special")
    for eps in (1e-1, 1e-4, 1e-7):
        u1 = (np.arange(256) + 0.5) / 256
        cos_psi, _, jacobian = many(jnp.asarray(1 / eps), jnp.asarray(u1))
        exact = 4 * np.sqrt(1 + eps**2) * special.ellipe(1 / (1 + eps**2))
        assert np.mean(np.sqrt(eps**2 + np.asarray(cos_psi) ** 2) * jacobian) == pytest.approx(exact, rel=1e-12)


def test_gradients_are_finite_at_every_incidence():
    def total(w, u1):
        return sum(grazing_azimuth(grazing_tangent(w), u1))

    grad = jax.jit(jax.vmap(jax.grad(total, argnums=(0, 1))))
    theta = jnp.asarray([0.0, 1e-9, 0.7, np.pi / 2 - 1e-9, np.pi / 2])
    w = from_spherical(jnp.repeat(theta, 5), jnp.zeros(25))
    w = w._replace(z=jnp.maximum(w.z, 0.0).at[-5:].set(0.0))
    u1 = jnp.tile(jnp.asarray([0.0, 0.25, 0.3, 0.5, 1.0]), 5)
    assert all(np.all(np.isfinite(g)) for g in jax.tree.leaves(grad(w, u1)))
