"""The Phong lobe: albedo, reciprocity, its sampler's density, edges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from gonio.models.empirical.phong import Phong
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical
from support import helpers

MU = np.array([1.0, 0.9, 0.5, 0.05, 1e-3, 1e-6])


@jax.jit
@jax.vmap
def mapped_albedo(wi, n):
    x, w = leggauss(48)
    u1, u2 = (np.arange(4)[:, None] + 0.5 + 0.5 * x) / 4, (np.arange(2)[:, None] + 0.5 + 0.5 * x) / 2
    a, b = (g.ravel() for g in np.meshgrid(u1.ravel(), u2.ravel(), indexing="ij"))
    weight = np.outer(np.tile(w, 4) / 8, np.tile(w, 2) / 4).ravel()

    def node(u, v):
        wo, jacobian = Phong(n).lobe_map(wi, u, v)
        return Phong(n).f(wi, wo) * jnp.maximum(wo.z, 0.0) * jacobian

    return jnp.sum(weight * jax.vmap(node)(a, b))


def albedos(n):
    theta = jnp.asarray(np.arctan2(np.sqrt((1 - MU) * (1 + MU)), MU))
    return np.asarray(mapped_albedo(from_spherical(theta, jnp.full(MU.size, 0.4)), jnp.full(MU.size, n)))


def reference_albedo(n, mu):
    """Rings about the mirror direction, cut by the horizon; the ring's mean in closed form, SciPy over the rings."""
    quad = pytest.importorskip("scipy.integrate").quad
    sin_i = np.sqrt((1 - mu) * (1 + mu))

    def ring(c):
        a, b = c * mu, np.sqrt((1 - c) * (1 + c)) * sin_i
        psi = np.pi if a >= b else np.arccos(-a / b)
        return c**n * 2 * (a * psi + b * np.sin(psi))

    touch = sin_i  # the ring at cosβ = sinθ_i touches the horizon
    parts = [quad(ring, lo, hi, epsabs=1e-14, epsrel=1e-13)[0] for lo, hi in ((0, touch), (touch, 1)) if hi > lo]
    return (n + 2) / (2 * np.pi) * sum(parts)


@pytest.mark.parametrize("n", [0.0, 0.5, 3.0, 100.0])
def test_albedo_against_rings_cut_by_the_horizon(n):
    expected = [reference_albedo(n, mu) for mu in MU]
    np.testing.assert_allclose(albedos(n), expected, atol=2e-11)
    if n == 0:
        np.testing.assert_allclose(albedos(n), (1 + MU) / 2, atol=1e-13)


def test_a_narrow_lobe_has_the_albedo_of_the_cosine():
    # Where the horizon cuts nothing, the mean of the cosine over the lobe is cosθ_i times that at the normal.
    np.testing.assert_allclose(albedos(1e6)[:4], MU[:4], rtol=1e-12)
    assert albedos(7.0)[0] == pytest.approx(1.0, abs=1e-13)


def test_reciprocity_to_the_last_bit():
    rng = np.random.default_rng(5)
    wi, wo = (
        from_spherical(jnp.asarray(rng.uniform(0, 1.8, 500)), jnp.asarray(rng.uniform(0, 7, 500))) for _ in range(2)
    )
    for n in (0.0, 2.5, 1e4):
        assert np.array_equal(evaluate(Phong(n), wi, wo), evaluate(Phong(n), wo, wi))


def test_a_sharp_lobe_keeps_its_digits():
    # n = 1e6, 1e-3 rad off the mirror direction: cosⁿβ by mpmath.
    mp = pytest.importorskip("mpmath")
    wi, wo = from_spherical(0.5, np.pi), from_spherical(0.501, 0.0)
    with mp.workdps(40):
        beta = mp.mpf("0.001")
        exact = float((10**6 + 2) / (2 * mp.pi) * mp.cos(beta) ** (10**6))
    assert Phong(1e6).f(wi, wo) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("n", [0.0, 20.0])
def test_samples_have_the_stated_density(n):
    stats = pytest.importorskip("scipy.stats")
    wi = from_spherical(0.9, 2.0)
    count, cells = 40_000, 12
    u = np.random.default_rng(11).random((2, count))
    wo, _ = jax.jit(jax.vmap(lambda a, b: Phong(n).sample(wi, a, b)))(*jnp.asarray(u))
    z = np.clip(np.asarray(wo.z), -1, 1)
    phi = np.arctan2(wo.y, wo.x)
    seen, _, _ = np.histogram2d(z, phi, cells, [[-1, 1], [-np.pi, np.pi]])
    fine = 40
    zc = -1 + 2 * (np.arange(cells * fine) + 0.5) / (cells * fine)
    pc = -np.pi + 2 * np.pi * (np.arange(cells * fine) + 0.5) / (cells * fine)
    zz, pp = np.meshgrid(zc, pc, indexing="ij")
    s = np.sqrt(1 - zz**2)
    grid = Direction(*(jnp.asarray(c.ravel()) for c in (s * np.cos(pp), s * np.sin(pp), zz)))
    density = np.asarray(jax.jit(jax.vmap(lambda w: Phong(n).pdf(wi, w)))(grid)).reshape(zz.shape)
    share = density.reshape(cells, fine, cells, fine).mean((1, 3)) * 4 * np.pi / cells**2
    assert share.sum() == pytest.approx(1, abs=2e-3)
    expected = share / share.sum() * count
    busy = expected > 10
    pooled_seen = np.append(seen[busy], seen[~busy].sum())
    pooled_expected = np.append(expected[busy], expected[~busy].sum())
    keep = pooled_expected > 5
    chi2 = np.sum((pooled_seen - pooled_expected)[keep] ** 2 / pooled_expected[keep])
    assert stats.chi2.sf(chi2, keep.sum() - 1) > 1e-3


def test_gradients_are_finite_at_every_edge():
    edge = [
        Direction(0.0, 0.0, 1.0),
        from_spherical(np.pi / 2 - 1e-9, 0.0),
        Direction(1.0, 0.0, 0.0),
        Direction(-1.0, 0.0, 0.0),
        from_spherical(1.7, 1.0),
        from_spherical(0.7, 0.3),
    ]
    pairs = [(a, b) for a in edge for b in edge]
    wi, wo = (Direction(*(jnp.stack([jnp.asarray(p[i][c]) for p in pairs]) for c in range(3))) for i in range(2))
    value = jax.jit(jax.vmap(jax.grad(lambda n, a, b: Phong(n).f(a, b), argnums=(0, 1, 2)), in_axes=(None, 0, 0)))
    drawn = jax.jit(
        jax.vmap(jax.grad(lambda w, n: sum(Phong(n).sample(w, 0.3, 0.0)[0]), argnums=(0, 1)), in_axes=(0, None))
    )
    for n in (1.0, 50.0, 1e6):
        assert all(np.all(np.isfinite(g)) for g in jax.tree.leaves(value(jnp.asarray(n), wi, wo)))
        assert all(np.all(np.isfinite(g)) for g in jax.tree.leaves(drawn(wi, jnp.asarray(n))))


@pytest.mark.parametrize("sharpness", [5, 50, 1000])
def test_values_against_an_independent_implementation(sharpness):
    data = np.load(helpers.shared("oracle", "models_double.npz"), allow_pickle=False)
    at = list(data["model"]).index(f"Phong(albedo=[1,1,1], sharpness={sharpness})")
    found = evaluate(Phong(float(sharpness)), *(Direction(*data[w].T) for w in ("wi", "wo")))
    np.testing.assert_allclose(found, data["f"][at, :, 0], rtol=2e-12, atol=1e-18)
