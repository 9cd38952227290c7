"""Moments of the reflection that light meets from within, at the boundary of a diffusing medium."""

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Channels
from gonio.models.fresnel import fresnel_average, fresnel_dielectric

NODES = 64


def first_moment(eta: Channels) -> Channels:
    """2C₁ = 2 ∫ F μ dμ from within, for a medium of index `eta` ≥ 1: what comes back of diffuse light."""
    eta = jnp.asarray(eta)
    return 1.0 - (1.0 - fresnel_average(None, eta, None)) / (eta * eta)


def second_moment(eta: Channels) -> Channels:
    """3C₂ = 3 ∫ F μ² dμ from within, by the angle outside: μ dμ = μₒ dμₒ/η², and beyond the critical angle F is 1."""
    eta = jnp.asarray(eta)
    x, w = np.polynomial.legendre.leggauss(NODES)
    v, weight = (jnp.asarray(a, eta.dtype) for a in ((x + 1) / 2, w / 2))

    def node(v: jax.Array, weight: jax.Array) -> Channels:
        mu = v * v
        inside = jnp.sqrt((eta - 1.0) * (eta + 1.0) + mu * mu) / eta
        return 2.0 * v * weight * (1.0 - fresnel_dielectric(mu, eta)) * inside * mu

    return 1.0 - 3.0 / (eta * eta) * jnp.sum(jax.vmap(node)(v, weight), 0)
