"""Sums, scalings and evaluation over arrays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.brdf import AbstractBRDF, Scaled, Sum, changed_terms, terms
from gonio.models.catalog import MODELS
from gonio.models.diffuse.lambert import Lambert
from gonio.models.evaluation import channel_count, evaluate
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.microfacet.ggx import GGX
from gonio.models.parameters import parameters_of


def test_operators_build_sums_and_scalings():
    brdf = Lambert(rho=0.3) + 0.5 * GGX(alpha=0.2)
    assert isinstance(brdf, Sum) and isinstance(brdf.parts[1], Scaled)
    wi, wo = from_spherical(0.3, 0.0), from_spherical(0.4, 3.0)
    expected = 0.3 / np.pi + 0.5 * float(evaluate(GGX(alpha=0.2), wi, wo))
    assert float(evaluate(brdf, wi, wo)) == pytest.approx(expected, rel=1e-15)
    with pytest.raises(TypeError):
        Lambert(rho=0.3) + 1.0


def test_terms_open_nested_sums_and_multiply_their_factors():
    nested = 2.0 * (Lambert(rho=0.1) + 0.5 * (GGX(alpha=0.2) + 3.0 * Lambert(rho=0.2)))
    assert [float(t.scale) for t in terms(nested)] == [2.0, 1.0, 3.0]


def test_directions_of_any_shape_broadcast():
    wi = from_spherical(np.linspace(0, 1.5, 4)[:, None], 0.0)
    wo = from_spherical(np.linspace(0, 1.5, 5)[None, :], 1.0)
    assert evaluate(GGX(alpha=0.3), wi, wo).shape == (4, 5)
    assert evaluate(Lambert(rho=jnp.array([0.1, 0.2])), wi, wo).shape == (4, 5, 2)
    assert channel_count(GGX(alpha=0.3)) is None and channel_count(Lambert(rho=[0.1, 0.2])) == 2


def test_zero_at_and_below_the_horizon():
    wi = Direction(*(jnp.array(c) for c in ([0.6, 1.0, 0.6], [0.0, 0.0, 0.0], [0.8, 0.0, -0.8])))
    wo = from_spherical(0.4, 1.0)
    assert np.array_equal(np.asarray(evaluate(Lambert(rho=0.5) + GGX(alpha=0.4), wi, wo)) > 0, [True, False, False])


def test_sums_sample_their_mixture():
    """E over the sampler of f cosθ/pdf is the albedo, whatever the mixture."""
    brdf = Lambert(rho=0.3) + 0.5 * GGX(alpha=0.3)
    wi = Direction(*(jnp.asarray(c) for c in (np.sin(0.8), 0.0, np.cos(0.8))))
    u = np.random.default_rng(2).random((2, 100_000))

    def weight(a, b):
        wo, _ = brdf.sample(wi, a, b)
        return brdf.f(wi, wo) * jnp.maximum(wo.z, 0) / brdf.pdf(wi, wo)

    from gonio.models.albedo import directional_albedo

    w = np.asarray(jax.jit(jax.vmap(weight))(*u))
    exact = float(directional_albedo(brdf, 0.8).value)
    assert abs(w.mean() - exact) < 5 * w.std() / np.sqrt(w.size)


def test_models_differ_by_their_changed_terms():
    a, lobe = Lambert(rho=jnp.array([0.2, 0.5])) + 0.3 * GGX(alpha=0.2), 0.3 * GGX(alpha=0.4)
    assert [type(m) for m in changed_terms(a, a)] == [Sum, Sum]  # nothing to leave out
    b = Lambert(rho=jnp.array([0.2, 0.5])) + lobe
    above, below = changed_terms(b, a)
    assert [len(m.terms()) for m in (above, below)] == [1, 1]
    pair = from_spherical(0.3, 0.0), from_spherical(0.5, 3.0)
    np.testing.assert_allclose(above.f(*pair) - below.f(*pair), b.f(*pair) - a.f(*pair), rtol=1e-12)
    assert changed_terms(a, Lambert(rho=0.1))[0] is a


def test_no_parameter_of_a_model_hides_what_every_model_has():
    members = {name for name in dir(AbstractBRDF) if not name.startswith("_")}
    for name in MODELS:
        assert not {*parameters_of(MODELS[name])} & members, name
