"""The logarithm of the beta function, to rounding."""

import jax.numpy as jnp
from jax.lax import lgamma

from gonio.models.arrays import Scalar

LARGE = 8.0
STIRLING = (1 / 12, -1 / 360, 1 / 1260, -1 / 1680, 1 / 1188, -691 / 360360, 1 / 156)


def log_beta(a: Scalar, b: Scalar) -> Scalar:
    """ln B(a, b) for a, b ≥ 1: to 1e-14, where `jax.scipy.special.betaln` is off by up to 1e-6.

    Γ(b)/Γ(a + b) of a large b by Stirling's series, whose leading terms are subtracted before they are rounded.
    """
    a, b = jnp.minimum(a, b), jnp.maximum(a, b)
    large = b >= LARGE
    z = jnp.where(large, b, LARGE)
    total = a + z
    ratio = a - (z - 0.5) * jnp.log1p(a / z) - a * jnp.log(total) + _remainder(z) - _remainder(total)
    small = jnp.where(large, 1.0, b)
    return lgamma(a) + jnp.where(large, ratio, lgamma(small) - lgamma(a + small))


def _remainder(z: Scalar) -> Scalar:
    """ln Γ(z) − (z − ½) ln z + z − ½ ln 2π, for z ≥ 8."""
    inverse2, value = 1.0 / (z * z), jnp.zeros_like(z)
    for c in STIRLING[::-1]:
        value = value * inverse2 + c
    return value / z
