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
    """Clenshaw's recurrence for even and odd terms apart, two chains that processors follow side by side.

    With y = 2x² − 1, T₂ₖ(x) = Tₖ(y) and T₂ₖ₊₁(x) = x Vₖ(y), of the third kind [Mason & Handscomb 2003, §1.2].
    """
    y = 2.0 * x * x - 1.0

    def rest(terms: Scalar) -> tuple[Scalar, Scalar]:
        def step(pair: tuple[Scalar, Scalar], c: Scalar) -> tuple[tuple[Scalar, Scalar], None]:
            above, this = pair
            # What is waited for, the term before, is multiplied and added at once.
            return (this, (c - above) + 2.0 * y * this), None

        zero = jnp.zeros(jnp.broadcast_shapes(terms.shape[1:], x.shape), terms.dtype)
        return jax.lax.scan(step, (zero, zero), terms[:0:-1], unroll=unroll)[0]

    even, odd = series[0::2], series[1::2]
    above, this = rest(even)
    total = (even[0] - above) + y * this
    above, this = rest(odd)
    return total + x * (((odd[0] - above) + 2.0 * y * this) - this)


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
