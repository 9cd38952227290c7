"""Chebyshev series: of many variables once, then of one variable many times."""

import jax
import jax.numpy as jnp

from gonio.models.arrays import Scalar


def chebyshev_basis(x: Scalar, n: int) -> Scalar:
    """T₀(x) ... T₍ₙ₋₁₎(x) for x in [−1, 1], by their recurrence."""

    def step(pair: tuple[Scalar, Scalar], _: None) -> tuple[tuple[Scalar, Scalar], Scalar | None]:
        last, this = pair
        return (this, 2.0 * x * this - last), last

    return jax.lax.scan(step, (jnp.ones_like(x), x), None, length=n)[1]


def _summed(series: Scalar, x: Scalar, unroll: bool) -> Scalar:
    def step(pair: tuple[Scalar, Scalar], c: Scalar) -> tuple[tuple[Scalar, Scalar], Scalar | None]:
        above, this = pair
        return (this, 2.0 * x * this - above + c), None

    zero = jnp.zeros(jnp.broadcast_shapes(series.shape[1:], x.shape), series.dtype)
    (above, this), _ = jax.lax.scan(step, (zero, zero), series[:0:-1], unroll=unroll)
    return x * this - above + series[0]


@jax.custom_jvp
def clenshaw(series: Scalar, x: Scalar) -> Scalar:
    """Σ series[k] Tₖ(x); the trailing axes of `series` and the shape of x broadcast.

    In one loop over the directions: a loop over the terms would read and write them all at every step.
    """
    return _summed(series, x, True)


@clenshaw.defjvp
def _clenshaw_jvp(primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    # Term after term written out, slopes of slopes of a coat take a minute to compile.
    return jax.jvp(lambda series, x: _summed(series, x, False), primals, tangents)
