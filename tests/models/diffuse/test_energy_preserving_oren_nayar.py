"""The rough diffusers: closed albedos, reciprocity to the last bit, finite gradients, Lambert at r = 0."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from gonio.models.diffuse.energy_preserving_oren_nayar import C1, C2, EON, FujiiOrenNayar, fujii_g
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

MU = np.array([1.0, 0.9999, 0.9, 0.5, 0.2, 0.05, 1e-3, 1e-6])
THETA = np.arctan2(np.sqrt(1 - MU**2), MU)


def textbook_albedo(mu, r):
    """Fujii's albedo at ρ = 1, as the paper writes it (no care for grazing or normal incidence)."""
    s = np.sqrt(1 - mu**2)
    g = s * (np.arccos(mu) - s * mu) + 2 / 3 * ((s / mu) * (1 - s**3) - s)
    a = 1 / (1 + (0.5 - 2 / (3 * np.pi)) * r)
    return a + r * a / np.pi * g


@jax.jit
@jax.vmap
def mapped(wi, r, rho):
    """(Fujii's, EON's) albedo by plain Gauss panels in the models' own map."""
    x, w = leggauss(24)
    u1, u2 = (np.arange(4)[:, None] + 0.5 + 0.5 * x) / 4, (np.arange(2)[:, None] + 0.5 + 0.5 * x) / 2
    a, b = (g.ravel() for g in np.meshgrid(u1.ravel(), u2.ravel(), indexing="ij"))
    weight = np.outer(np.tile(w, 4) / 8, np.tile(w, 2) / 4).ravel()

    def node(model, u, v):
        wo, jacobian = model.lobe_map(wi, u, v)
        return model.f(wi, wo) * wo.z * jacobian

    models = FujiiOrenNayar(rho, r), EON(rho, r)
    return tuple(jnp.sum(weight * jax.vmap(lambda u, v, m=m: node(m, u, v))(a, b)) for m in models)


@pytest.mark.parametrize(("rho", "r"), [(1.0, 0.0), (1.0, 0.4), (1.0, 1.0), (0.3, 1.0), (0.0, 1.0)])
def test_albedos_against_the_closed_forms(rho, r):
    full = np.full(MU.shape, 1.0)
    fujii, eon = mapped(from_spherical(jnp.asarray(THETA), jnp.full(MU.size, 0.4)), r * full, rho * full)
    single = textbook_albedo(MU, r)
    np.testing.assert_allclose(fujii, rho * single, atol=1e-11)
    average = (1 + C2 * r) / (1 + C1 * r)
    rho_ms = rho**2 * average / (1 - rho * (1 - average))
    np.testing.assert_allclose(eon, rho * single + rho_ms * (1 - single), atol=1e-11)
    if rho == 1:
        np.testing.assert_allclose(eon, 1.0, atol=1e-13)


def test_average_of_fujii_albedo_is_c2():
    """2 ∫ Ê μ dμ = A(1 + c2 r), hence 2 ∫ (G/π) μ dμ = c2."""
    x, w = leggauss(60)
    theta = (x + 1) * np.pi / 4
    g = fujii_g(from_spherical(jnp.asarray(theta), jnp.zeros(60)))
    found = np.sum(w * np.pi / 4 * 2 * np.asarray(g) / np.pi * np.cos(theta) * np.sin(theta))
    assert found == pytest.approx(C2, rel=1e-13)


def directions(n, seed):
    rng = np.random.default_rng(seed)
    return from_spherical(jnp.asarray(rng.uniform(0, np.pi / 2, n)), jnp.asarray(rng.uniform(0, 7, n)))


def test_reciprocity_to_the_last_bit():
    wi, wo = directions(500, 1), directions(500, 2)
    for model in (FujiiOrenNayar(0.4, 0.7), EON(0.4, 0.7)):
        assert np.array_equal(evaluate(model, wi, wo), evaluate(model, wo, wi))


def test_lambert_at_no_roughness_and_channels():
    wi, wo = directions(500, 3), directions(500, 4)
    rho = jnp.asarray([0.1, 0.5, 1.0])
    for model in (FujiiOrenNayar(rho, 0.0), EON(rho, 0.0)):
        values = evaluate(model, wi, wo)
        np.testing.assert_allclose(values, np.broadcast_to(rho / np.pi, (500, 3)), rtol=1e-15)


def test_gradients_are_finite_at_every_edge():
    normal, grazing = Direction(0.0, 0.0, 1.0), from_spherical(np.pi / 2 - 1e-9, 0.0)
    below, slanted = from_spherical(1.7, 1.0), from_spherical(0.7, 0.3)
    horizon = Direction(1.0, 0.0, 0.0)
    edge = [normal, grazing, below, slanted, horizon]
    wi, wo = zip(*((a, b) for a in edge for b in edge), strict=True)
    stacked = [Direction(*(jnp.stack([jnp.asarray(c) for c in p]) for p in zip(*w, strict=True))) for w in (wi, wo)]
    for model_class in (FujiiOrenNayar, EON):
        grad = jax.grad(lambda rho, r, a, b, m=model_class: m(rho, r).f(a, b), argnums=(0, 1, 2, 3))
        grads = jax.jit(jax.vmap(grad, in_axes=(None, None, 0, 0)))
        for rho, r in ((0.5, 0.5), (1.0, 0.0), (0.0, 1.0)):
            found = grads(jnp.asarray(rho), jnp.asarray(r), *stacked)
            assert all(np.all(np.isfinite(g)) for g in jax.tree.leaves(found))
