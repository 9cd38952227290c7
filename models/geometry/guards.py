"""Cosines to divide by, and numbers that are too small to be squared."""

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from gonio.models.arrays import Scalar


def positive(cosine: Scalar) -> Scalar:
    """A cosine to divide by: itself, but more than 0; below tiny^(1/5) no derivative is taken by it.

    There (3e-8 in single, 5e-62 in double precision) the slope of a law with three reciprocal cosines is beyond the
    largest number, while its value may still be a number, and is right.
    """
    tiny = float(jnp.finfo(jnp.result_type(cosine)).tiny)
    return jnp.where(cosine >= tiny**0.2, cosine, jax.lax.stop_gradient(jnp.maximum(cosine, tiny)))


def least_positive(x: Scalar) -> Scalar:
    """x, but no less than the least normal number: for the logarithm of what is raised to a power and is 0 below 0.

    Unlike 1 in its place it is near the limit: XLA may compute x twice and round it once to either side of 0.
    """
    return jnp.maximum(x, float(jnp.finfo(jnp.result_type(x)).tiny))


def grazing_scale(dtype: DTypeLike) -> float:
    """A power of two by which what is as small as a grazing cosine may be multiplied, and then squared.

    2³⁰ in single precision: squares, and their inverses in gradients, of 1e-16 to 2 are then numbers; 2²⁰⁰ in double.
    """
    return 2.0**30 if jnp.finfo(dtype).bits == 32 else 2.0**200
