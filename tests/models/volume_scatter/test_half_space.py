"""Half spaces of isotropic scatterers: closed albedos."""

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.albedo import directional_albedo
from gonio.models.volume_scatter.chandrasekhar_h import h_isotropic
from gonio.models.volume_scatter.half_space import Chandrasekhar, LommelSeeliger

THETA = np.arccos([1.0, 0.9, 0.5, 0.1, 0.01, 1e-5])
MU = np.cos(THETA)


def test_single_scattering_albedo():
    found = directional_albedo(LommelSeeliger([0.3, 1.0]), THETA)
    once = 0.5 * (1 - MU * np.log1p(1 / MU))
    np.testing.assert_allclose(found.value, once[:, None] * [0.3, 1.0], atol=1e-14)
    assert np.all(found.bound < 1e-9)


def test_albedo_of_all_orders():
    """E = 1 − √(1 − w) H(μ): 1 without absorption, 1 − √(1 − w) at grazing."""
    w = np.array([0.0, 0.5, 1 - 1e-6, 1.0])
    found = directional_albedo(Chandrasekhar(list(w)), THETA)
    np.testing.assert_allclose(found.value[:, 3], 1.0, atol=1e-13)
    np.testing.assert_allclose(found.value[-1], 1 - np.sqrt(1 - w), atol=1e-4)
    assert np.all(found.bound < 1e-9)
    h = np.asarray(jax.jit(jax.vmap(h_isotropic, in_axes=(0, None)))(jnp.asarray(MU), jnp.asarray(w)))
    np.testing.assert_allclose(found.value, 1 - np.sqrt(1 - w) * h, atol=1e-13)
