"""The back-vector lobe: GGX of the mirrored light, peak at the light, energy of GGX."""

import jax.numpy as jnp
import numpy as np

from gonio.models.albedo import directional_albedo
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.microfacet.ggx import GGX
from gonio.models.microfacet.retro import Retro


def test_it_is_ggx_of_the_mirrored_light():
    rng = np.random.default_rng(8)
    wi, wo = (from_spherical(jnp.asarray(rng.uniform(0, 1.7, 200)), jnp.asarray(rng.uniform(0, 7, 200))) for _ in "io")
    mirrored = Direction(-wi.x, -wi.y, wi.z)
    for options in ({"alpha": 0.02}, {"alpha_x": 0.1, "alpha_y": 0.5, "f0": 0.2, "smith": "separable"}):
        f = evaluate(Retro(**options), wi, wo)
        np.testing.assert_array_equal(f, evaluate(GGX(**options), mirrored, wo))
        np.testing.assert_allclose(f, evaluate(Retro(**options), wo, wi), rtol=1e-12)


def test_it_is_brightest_towards_the_light():
    theta = jnp.radians(jnp.asarray([0.0, 30.0, 60.0]))
    wi = from_spherical(theta, jnp.full(3, 0.3))
    f = [evaluate(Retro(alpha=0.01), wi, from_spherical(theta + d, jnp.full(3, 0.3))) for d in (0.0, 0.01)]
    assert np.all(np.asarray(f[0]) > 1.5 * np.asarray(f[1]))
    # D at the normal over 4 cos²θ, without masking to speak of.
    np.testing.assert_allclose(f[0], 1e4 / (4 * np.pi * np.cos(theta) ** 2), rtol=1e-3)


def test_it_reflects_what_ggx_reflects():
    mu = np.array([0.9, 0.4, 0.05])
    found = directional_albedo(Retro(alpha=1.0), np.arccos(mu), 1.0)
    np.testing.assert_allclose(found.value, 1 - mu * np.log1p(1 / mu), atol=1e-9)
