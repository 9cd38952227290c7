"""The cosine-weighted hemisphere: the importance map of a perfect diffuser."""

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction


def cosine_sample(u1: Scalar, u2: Scalar) -> Direction:
    """Direction of density cosθ/π from (u1, u2) in [0, 1)²: u1 is the azimuth in turns, sin²θ = u2 [Malley]."""
    phi = 2 * jnp.pi * u1
    sin_t = jnp.sqrt(u2)
    return Direction(sin_t * jnp.cos(phi), sin_t * jnp.sin(phi), jnp.sqrt(1.0 - u2))


def cosine_pdf(wo: Direction) -> Scalar:
    """Density of `cosine_sample`, 1/sr; 0 below the horizon."""
    return jnp.maximum(wo.z, 0.0) / jnp.pi
