"""Bessel functions of the first kind whose integer order is an array like any other."""

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Scalar

PAIRS = 64
"""Pairs of orders, from 128 down: J is below 1e-25 there for every argument up to `LARGEST`."""
LARGEST = 64.0


def bessel_j(order: Scalar, x: Scalar) -> Scalar:
    """J_m(x) of whole numbers m ≥ 0 and x in [0, 64]; arrays broadcast; 0 for orders above 128.

    By the ratios J_n/J_(n−1) = x/(2n − x J_(n+1)/J_n), downwards, where they are stable, and 1 = J_0 + 2 Σ J_2k
    [Gautschi 1967, §3]: every order to its own relative precision.
    """
    order, x = jnp.broadcast_arrays(order, x)

    def step(state: tuple[Scalar, Scalar, Scalar], even: Scalar) -> tuple[tuple[Scalar, Scalar, Scalar], None]:
        ratio, rest, product = state
        upper = _ratio(x, even, ratio)
        lower = _ratio(x, even - 1.0, upper)
        product = jnp.where(even <= order, product * upper, product)
        product = jnp.where(even - 1.0 <= order, product * lower, product)
        return (lower, upper * lower * (1.0 + rest), product), None

    evens = jnp.asarray(np.arange(2 * PAIRS, 0, -2.0), x.dtype)
    (_, rest, product), _ = jax.lax.scan(step, (jnp.zeros_like(x), jnp.zeros_like(x), jnp.ones_like(x)), evens)
    return jnp.where(order > 2 * PAIRS, 0.0, product / (1.0 + 2.0 * rest))


def _ratio(x: Scalar, n: Scalar, above: Scalar) -> Scalar:
    below = 2.0 * n - x * above
    return x / jnp.where(below == 0, jnp.finfo(x.dtype).eps, below)
