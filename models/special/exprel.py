"""The relative exponential, by which power laws are integrated over any range with any exponent."""

import jax.numpy as jnp

from gonio.models.arrays import Scalar


def exprel(x: Scalar) -> Scalar:
    """(eˣ − 1)/x, to full precision at 0."""
    small = jnp.abs(x) < 1e-5
    safe = jnp.where(small, -1.0, x)
    return jnp.where(small, 1.0 + x / 2 + x * x / 6, jnp.expm1(safe) / safe)
