"""Minnaert, Burley's diffuse term and Ashikhmin and Shirley's: closed albedos and an independent implementation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.diffuse.ashikhmin_shirley_diffuse import AshikhminShirleyDiffuse
from gonio.models.diffuse.burley import BurleyDiffuse
from gonio.models.diffuse.minnaert import Minnaert
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from support import helpers

THETA = np.arccos([1.0, 0.9, 0.5, 0.1, 0.01, 1e-5])
MU = np.cos(THETA)


@pytest.mark.parametrize("k", [0.0, 0.55, 1.0, 5.0])
def test_minnaert_albedo(k):
    albedo = directional_albedo(Minnaert(0.8, k), THETA)
    np.testing.assert_allclose(albedo.value, 0.8 * MU ** (k - 1), rtol=1e-13)
    assert np.all(albedo.bound <= 1e-10 * np.maximum(albedo.value, 1))


def test_minnaert_of_channels_that_differ():
    albedo = directional_albedo(Minnaert([0.8, 0.5], [0.3, 2.7]), THETA)
    np.testing.assert_allclose(albedo.value, [0.8, 0.5] * MU[:, None] ** [-0.7, 1.7], rtol=1e-10)


def test_minnaert_draws_in_proportion():
    """f cosθ/pdf of its own directions is the albedo, whatever is drawn."""
    model, wi = Minnaert(0.8, 0.4), Direction(0.6, 0.0, 0.8)

    def weight(u1, u2):
        wo, _ = model.sample(wi, u1, u2)
        return model.f(wi, wo) * wo.z / model.pdf(wi, wo)

    u = np.random.default_rng(3).random((2, 200))
    np.testing.assert_allclose(jax.jit(jax.vmap(weight))(*jnp.asarray(u)), 0.8 * 0.8 ** (0.4 - 1), rtol=1e-13)


def test_minnaert_at_the_horizon_in_single_precision():
    """Values there are still numbers; derivatives by cosines below 3e-8, which would be none, are not taken."""
    grazing = Direction(*(jnp.asarray(c, jnp.float32) for c in (1.0, 0.0, 1e-12)))
    value, slopes = jax.jit(jax.value_and_grad(lambda k, w: Minnaert(jnp.float32(1), k).f(w, w), argnums=(0, 1)))(
        jnp.float32(0), grazing
    )
    assert value.dtype == jnp.float32 and value == pytest.approx(1e24 / (2 * np.pi), rel=1e-5)
    assert all(np.isfinite(s) for s in jax.tree.leaves(slopes))


def test_ashikhmin_shirley_albedo():
    """Closed form: the factor 28/23 is 1/∫(1 − (1 − μ/2)⁵) 2μ dμ."""
    found = directional_albedo(AshikhminShirleyDiffuse(0.6, 0.05), THETA)
    np.testing.assert_allclose(found.value, -0.6 * 0.95 * np.expm1(5 * np.log1p(-MU / 2)), rtol=1e-13)


def test_ashikhmin_shirley_against_an_independent_implementation():
    """AshikhminShirleyFull less AshikhminShirley there, its reflectances our rd and rs: no difference of definition.

    Its (1 − μ/2)⁵ loses three digits at grazing, 6e-14.
    """
    data = np.load(helpers.shared("oracle", "models_double.npz"), allow_pickle=False)
    names, (wi, wo) = list(data["model"]), (Direction(*data[w].T) for w in ("wi", "wo"))
    found = evaluate(AshikhminShirleyDiffuse([0.5, 0.3, 0.1], [0.05, 0.3, 0.9]), wi, wo)
    for n in (5, 50, 1000):
        gloss = f"fresnelReflectance=[0.05,0.3,0.9], sharpness={n})"
        whole = data["f"][names.index(f"AshikhminShirleyFull(diffuseReflectance=[0.5,0.3,0.1], {gloss}")]
        expected = whole - data["f"][names.index(f"AshikhminShirley({gloss}")]
        assert np.all(abs(found - expected) <= 1e-13 * whole)


def test_burley_albedo_where_it_gains():
    found = directional_albedo(BurleyDiffuse(1.0, 1.0), np.arccos([1.0, 0.2, 0.05, 0.01]))
    np.testing.assert_allclose(found.value, [1.04, 1.25, 1.46, 1.54], atol=5e-3)
    assert np.all(found.bound < 1e-9)


def test_burley_at_normal_incidence():
    """There F90 − 1 = roughness (1 + μ) − ½ and the factor of wi is 1: a polynomial in μ."""
    roughness = 0.3
    mu = np.polynomial.Polynomial([0, 1])
    integrand = 2 * mu * (1 + (roughness * (1 + mu) - 0.5) * (1 - mu) ** 5)
    expected = 0.7 * integrand.integ()(1)
    assert directional_albedo(BurleyDiffuse(0.7, roughness), 0.0).value == pytest.approx(expected, rel=1e-13)
