"""How the unit interval is spread over the slopes of a facet along one azimuth (see `gonio.models.warps.slopes`).

Each law is (slope in units of the width, its derivative by v) for v in [0, 1].
"""

from collections.abc import Callable

import jax.numpy as jnp

from gonio.models.arrays import Scalar

Law = Callable[[Scalar, Scalar, Scalar], tuple[Scalar, Scalar]]
"""(slope, its derivative by v) of v in [0, 1], between a low and a high slope."""

S_MAX = 8.6  # exp(−S_MAX²/2) = 9e-17: the lobe beyond is below rounding


def linear_law(v: Scalar, low: Scalar, high: Scalar) -> tuple[Scalar, Scalar]:
    """Equal steps from low to high, for a lobe that falls as a Gaussian."""
    return low + v * (high - low), high - low


def power_law(v: Scalar, low: Scalar, high: Scalar) -> tuple[Scalar, Scalar]:
    """Equal steps of the inverse hyperbolic sine from low to high, for a lobe whose tails fall as a power."""
    start, stop = jnp.arcsinh(low), jnp.arcsinh(high)
    x = start + v * (stop - start)
    return jnp.sinh(x), jnp.cosh(x) * (stop - start)


def horizon_law(v: Scalar, last: Scalar, horizon: Scalar, layer: Scalar) -> tuple[Scalar, Scalar]:
    """`power_law` from 0 to min(last, horizon), whose second half (v > ½) crowds at the horizon.

    Long tails still reflect there, and Smith's masking falls to 0 within cosθo = `layer`, the width: steps grow from
    the horizon as a hyperbolic sine of that scale.
    """
    x_max = jnp.arcsinh(jnp.minimum(last, horizon))
    layer = jnp.where(horizon < last, layer, 1.0)
    reach = jnp.arcsinh(0.5 * x_max / layer)
    outer = v > 0.5
    back = jnp.where(outer, 2.0 * (1.0 - v), 1.0) * reach
    x = jnp.where(outer, x_max - layer * jnp.sinh(back), x_max * v)
    rate = jnp.where(outer, 2.0 * layer * jnp.cosh(back) * reach, x_max)
    return jnp.sinh(x), jnp.cosh(x) * rate


def power_rate(x: Scalar) -> Scalar:
    """√((eˣ − 1)/x), to full precision at 0."""
    small = x < 1e-5
    safe = jnp.where(small, 1.0, x)
    return jnp.where(small, 1.0 + x / 4, jnp.sqrt(jnp.expm1(safe) / safe))


def power_reach(length2: Scalar, s: Scalar) -> Scalar:
    """The radius of a slope s (in units of the widths) on a ray of unit slope √length2, at most S_MAX.

    cosθ_h = exp(−length2 · radius²/2), so that the lobe, cosθ_h to the power 1/length2 − 1, is Gaussian in the radius.
    """
    return jnp.minimum(jnp.sqrt(jnp.log1p(length2 * s * s) / length2), S_MAX)


def power_slope(length2: Scalar, radius: Scalar) -> tuple[Scalar, Scalar]:
    """The slope at a radius, the inverse of `power_reach`, and its derivative."""
    x = length2 * radius * radius
    rate = power_rate(x)
    return radius * rate, jnp.exp(x) / rate
