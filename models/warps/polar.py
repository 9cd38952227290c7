"""The outgoing hemisphere in equal steps of both angles, for what is smooth in them."""

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction, from_spherical


def polar_map(u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)) with θ = πu2/2 and φ = 2πu1; the cosine's own map has roots of u2 at both ends."""
    wo = from_spherical(0.5 * jnp.pi * u2, 2 * jnp.pi * u1)
    return wo, jnp.pi**2 * jnp.sin(0.5 * jnp.pi * u2)
