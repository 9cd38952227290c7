"""Distributions of microfacet slopes: density D, Smith's masking and sampling, written in components.

A facet of normal m has the slopes (m.x, m.y)/m.z; widths `alpha_x`, `alpha_y` > 0 are those of the distribution
(Beckmann: √2 times the rms slope). Smith's G₁ = 1/(1 + Λ) and Λ come multiplied out with the cosine w.z: w.z/G₁
= w.z (1 + Λ), w.z Λ and w.z (1 + 2Λ), so that nothing divides by a cosine that may be 0.
"""

import jax.numpy as jnp
from jax.scipy.special import erf, erfc

from gonio.models.brdf import Direction, Scalar
from gonio.models.geometry.directions import normalize

_SQRT_PI = 1.7724538509055159


def _stretched(w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    return (alpha_x * w.x) ** 2 + (alpha_y * w.y) ** 2


def _roughness_along(w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    # The guard keeps the square root's slope finite at normal incidence, where Smith's functions do not depend on it.
    b2 = _stretched(w, alpha_x, alpha_y)
    return jnp.sqrt(jnp.maximum(b2, 1e-30))


def ggx_d(m: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    """GGX density of normals, 1/sr [Walter 2007, eq. 33; Burley 2012, eq. 13 anisotropic]; 0 for m.z ≤ 0.

    In components: the textbook's cos²(α² − 1) + 1 loses all digits in float32 near m = z for small alpha.
    """
    s = (m.x * (1.0 / alpha_x)) ** 2 + (m.y * (1.0 / alpha_y)) ** 2 + m.z**2
    return jnp.where(m.z > 0, 1.0 / (jnp.pi * alpha_x * alpha_y * s**2), 0.0)


def ggx_cos_1_plus_2_lambda(w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    """√(w.z² + α_x²w.x² + α_y²w.y²), that is w.z (1 + 2Λ) [Heitz 2014, eq. 72 and 85]."""
    return jnp.sqrt(w.z**2 + _stretched(w, alpha_x, alpha_y))


def ggx_cos_over_g1(w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    """L(w) = w.z (1 + Λ(w)) of GGX [Heitz 2014, eq. 72], for w.z ≥ 0."""
    return 0.5 * (w.z + ggx_cos_1_plus_2_lambda(w, alpha_x, alpha_y))


def ggx_normal(alpha: Scalar, u1: Scalar, u2: Scalar) -> Direction:
    """Normal drawn from the isotropic GGX D cosθ [Walter 2007, eq. 35 and 36]."""
    r = alpha * jnp.sqrt(u2 / (1.0 - u2))
    z = 1.0 / jnp.sqrt(1.0 + r * r)
    return Direction(r * z * jnp.cos(2 * jnp.pi * u1), r * z * jnp.sin(2 * jnp.pi * u1), z)


def ggx_visible_normal(wi: Direction, alpha_x: Scalar, alpha_y: Scalar, u1: Scalar, u2: Scalar) -> Direction:
    """Normal drawn from the GGX normals visible from `wi`, by spherical caps [Dupuy & Benyoub 2023, listing 3]."""
    w = normalize(Direction(alpha_x * wi.x, alpha_y * wi.y, wi.z))
    phi = 2 * jnp.pi * u1
    z = (1.0 - u2) * (1.0 + w.z) - w.z
    s = jnp.sqrt(jnp.clip(1.0 - z * z, 0.0, 1.0))
    h = Direction(s * jnp.cos(phi) + w.x, s * jnp.sin(phi) + w.y, z + w.z)
    return normalize(Direction(alpha_x * h.x, alpha_y * h.y, jnp.maximum(h.z, 0.0)))


def beckmann_d(m: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    """Beckmann density of normals, 1/sr [Walter 2007, eq. 25, anisotropic]; 0 for m.z ≤ 0.

    Beyond tan² = 745 (of the scaled slope) the exponential is 0 in double precision, while powers of 1/m.z would
    overflow and turn its gradient into NaN: that range is masked before it is evaluated.
    """
    slope2 = (m.x / alpha_x) ** 2 + (m.y / alpha_y) ** 2
    live = (m.z > 0) & (slope2 < 745.0 * m.z**2)
    z2 = jnp.where(live, m.z, 1.0) ** 2
    tan2 = jnp.where(live, slope2, 0.0) / z2
    return jnp.where(live, jnp.exp(-tan2) / (jnp.pi * alpha_x * alpha_y * z2 * z2), 0.0)


def beckmann_cos_lambda(w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    """w.z Λ(w) of Beckmann, exact with erf [Walter 2007, eq. 26; Heitz 2014, eq. 68], for w.z ≥ 0."""
    b = _roughness_along(w, alpha_x, alpha_y)
    # erfc and the exponential are both 0 beyond 26; squaring a larger ratio could overflow in float32.
    a = jnp.minimum(w.z / b, 26.0)
    return 0.5 * (b * jnp.exp(-a * a) / _SQRT_PI - w.z * erfc(a))


def beckmann_cos_over_g1(w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    """L(w) = w.z (1 + Λ(w)) of Beckmann, exact [Walter 2007, eq. 26], for w.z ≥ 0."""
    b = _roughness_along(w, alpha_x, alpha_y)
    a = jnp.minimum(w.z / b, 26.0)
    return 0.5 * (w.z * (1.0 + erf(a)) + b * jnp.exp(-a * a) / _SQRT_PI)


def walter_cos_over_g1(w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
    """w.z / G₁ by the rational fit to Beckmann's G₁ that renderers use [Walter 2007, eq. 27], off by up to 6.3e-3."""
    b = _roughness_along(w, alpha_x, alpha_y)
    a = jnp.minimum(w.z / b, 1.6)
    fitted = b * (1.0 + 2.276 * a + 2.577 * a * a) / (3.535 + 2.181 * a)
    return jnp.where(w.z >= 1.6 * b, w.z, fitted)


def beckmann_normal(alpha_x: Scalar, alpha_y: Scalar, u1: Scalar, u2: Scalar) -> Direction:
    """Normal drawn from Beckmann's D cosθ [Walter 2007, eq. 28 and 29], stretched by the two widths."""
    phi = 2 * jnp.pi * u1
    r = jnp.sqrt(-jnp.log1p(-u2))
    return normalize(Direction(alpha_x * r * jnp.cos(phi), alpha_y * r * jnp.sin(phi), jnp.ones_like(r)))
