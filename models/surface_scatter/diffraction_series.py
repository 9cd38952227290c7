"""The sum over orders of diffraction from a Gaussian rough surface, at any roughness and any angle."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from gonio.models.arrays import Scalar

NODES = 120
ROOT_2PI = 2.5066282746310002
SMALLEST_G = 1e-30  # f is constant there to the last digit, and logarithms stay in single precision
SPREAD_FROM = 48.0  # where the orders below the first carry less than 1e-17 of the sum: g² exp(−g)


def _ln_factorial_rest(m: np.ndarray) -> np.ndarray:
    """ln m! − (m ln m − m + ½ ln 2πm), for 1 ≤ m."""
    whole = np.cumsum(np.log(m))
    return np.where(m < 12, whole - (m * np.log(m) - m + 0.5 * np.log(2 * np.pi * m)), _stirling_rest(1.0 / m))


def _stirling_rest(inverse_m: Scalar) -> Scalar:
    # The asymptotic series, to 1e-16 from m = 12 on.
    s = inverse_m * inverse_m
    return inverse_m * (1 / 12 - s * (1 / 360 - s * (1 / 1260 - s * (1 / 1680 - s * (1 / 1188 - s * 691 / 360360)))))


def _stirling_fall(inverse_m: Scalar) -> Scalar:
    """What `_stirling_rest` falls by in a step of m: less its derivative by m."""
    s = inverse_m * inverse_m
    return s * (1 / 12 - s * (1 / 120 - s * (1 / 252 - s * (1 / 240 - s * (1 / 132 - s * 691 / 32760)))))


@functools.lru_cache
def _first_orders() -> tuple[np.ndarray, np.ndarray]:
    m = np.arange(1, NODES + 1, dtype=float)
    return m, _ln_factorial_rest(m)


def lambert_w(log_y: Scalar) -> Scalar:
    """W(y) > 0, the root of w eʷ = y, from ln y, for y too large to be written; below ln y = −60, its value there."""
    log_y = jnp.maximum(log_y, -60.0)
    soft = jnp.logaddexp(log_y, 0.0)
    # Within 1 % [Winitzki 2003]; then Newton on w + ln w = ln y, whose error squares: 1e-2, 1e-5, 1e-10, 1e-20.
    w = soft * (1.0 - jnp.log1p(soft) / (2.0 + soft))
    for _ in range(3):
        w = w / (1.0 + w) * (1.0 + log_y - jnp.log(w))
    return w


def wave_series(g: Scalar, b: Scalar) -> Scalar:
    """R(g, b) = Σ_{m≥1} e^(−g) g^(m−1)/(m! m) e^(−b/m), for g ≥ 0, b ≥ 0: e^(−b) at g = 0, about e^(−b/g)/g² far off.

    The sum over orders of He et al. 1991, eq. 78, divided by g. Up to about fifty orders carry it: they are summed one
    by one. Beyond, the terms are an analytic hump around the order m* = g exp(W(2b/g²)/2), much wider than 1, and the
    trapezoidal rule on equal steps of m is exact to rounding (its error falls as exp(−2π²(width/step)²)), at the same
    number of terms for every g: no roughness at which one formula gives way to another.
    """
    return _series(*jnp.broadcast_arrays(jnp.maximum(g, SMALLEST_G), b))


@jax.custom_jvp
def _series(g: Scalar, b: Scalar) -> Scalar:
    return _sums(g, b)[0]


@_series.defjvp
def _series_jvp(primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    value, by_g, by_b = _sums(*primals)
    return value, by_g * tangents[0] + by_b * tangents[1]


def _sums(g: Scalar, b: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """(R, ∂R/∂g, ∂R/∂b)."""
    tilt = lambert_w(jnp.log(jnp.maximum(b, 1e-30)) + float(np.log(2.0)) - 2.0 * jnp.log(g))
    middle = g * jnp.exp(0.5 * tilt)
    spread = middle > SPREAD_FROM
    root = jnp.sqrt(jnp.maximum(middle, SPREAD_FROM))
    width = root / jnp.sqrt(1.0 + tilt)
    low = jnp.maximum(middle - 9.0 * width, 1.0)
    step = jnp.where(spread, (middle - low + width * (8.7 + 18.0 / root)) / (NODES - 1), 1.0)
    # m − g is kept as one number, which has its digits for large g.
    first = jnp.where(spread, low - g, 1.0 - g)

    # A loop, or XLA would compute what stands above anew for each of the terms.
    def add(total: tuple, orders: tuple) -> tuple[tuple, None]:
        terms = _terms(g, b, first, step, spread, *orders)
        return tuple(a + t for a, t in zip(total, terms, strict=True)), None

    each = tuple(jnp.asarray(a, g.dtype) for a in _first_orders())
    (value, by_g, by_b), _ = jax.lax.scan(add, (jnp.zeros_like(g),) * 3, each)
    scale = step / ROOT_2PI
    return value * scale, by_g * scale, by_b * scale


def _terms(
    g: Scalar, b: Scalar, first: Scalar, step: Scalar, spread: Bool[Array, "..."], order: Scalar, order_rest: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Terms of R, ∂R/∂g and ∂R/∂b."""
    above = first + step * (order - 1.0)
    m = jnp.where(spread, g + above, order)
    inverse_m, inverse_g = 1.0 / m, 1.0 / g
    rest = jnp.where(spread, _stirling_rest(jnp.minimum(inverse_m, 0.125)), order_rest)
    # ln(m/g), and ln(m/g) − (m − g)/m, whose leading terms cancel near m = g: there by the series of 2 artanh x.
    x = above / (g + m)
    near = jnp.abs(x) < 0.1
    x = jnp.where(near, x, 0.0)
    x2 = x * x
    odd = 1 / 3 + x2 * (1 / 5 + x2 * (1 / 7 + x2 * (1 / 9 + x2 * (1 / 11 + x2 * (1 / 13 + x2 / 15)))))
    far_log = jnp.log(jnp.where(near, 2.0, m * inverse_g))
    log_ratio = jnp.where(near, 2.0 * x * (1.0 + x2 * odd), far_log)
    excess = jnp.where(near, 2.0 * x2 * (1.0 / (1.0 + x) + x * odd), far_log - above * inverse_m)
    # g^(m−1) e^(−g)/(m! m) with Stirling's m!.
    term = jnp.exp(log_ratio - m * excess - rest - b * inverse_m) * (inverse_m * inverse_m * jnp.sqrt(inverse_m))
    # Of a hump, Σ ∂term/∂m = 0: less that, Σ term (m − g − 1)/g has no terms left that cancel over its width, √g.
    rise = jnp.where(near, 2.0 * x2 * (1.0 / (1.0 - x) - x * odd), above * inverse_g - far_log)
    hump = (
        rise - inverse_g - 1.5 * inverse_m + _stirling_fall(jnp.minimum(inverse_m, 0.125)) + b * inverse_m * inverse_m
    )
    by_g = jnp.where(spread, hump, (m - 1.0) * inverse_g - 1.0)
    return term, term * by_g, -term * inverse_m
