"""Facets with the density of a power of the cosine, cosⁿθ_h: sampling,."""

import jax.numpy as jnp

from gonio.models.brdf import Direction, Scalar
from gonio.models.geometry.half_vector import log_cosine


def exponent_at(h: Direction, sin2_h: Scalar, n_x: Scalar, n_y: Scalar) -> Scalar:
    """(n_x h.x² + n_y h.y²)/sin²θ_h: the exponent at the azimuth of h, their mean at the normal."""
    tilted = sin2_h > jnp.finfo(jnp.result_type(sin2_h)).tiny ** 0.5  # its square, in the gradient, is not 0
    share = jnp.where(tilted, h.x**2 / jnp.where(tilted, sin2_h, 1.0), 0.5)
    return n_y + (n_x - n_y) * share


def power_density(h: Direction, n_x: Scalar, n_y: Scalar) -> Scalar:
    """√((n_x+1)(n_y+1))/(2π) cosⁿθ_h, 1/sr: the density of `power_normal` [Ashikhmin & Shirley 2000]; 0 for h.z ≤ 0."""
    sin2_h = h.x**2 + h.y**2
    up = h.z > 0
    h = Direction(h.x, h.y, jnp.where(up, h.z, 1.0))
    value = jnp.exp(exponent_at(h, sin2_h, n_x, n_y) * log_cosine(h, sin2_h))
    return jnp.where(up, jnp.sqrt((n_x + 1.0) * (n_y + 1.0)) / (2 * jnp.pi) * value, 0.0)


def power_normal(n_x: Scalar, n_y: Scalar, u1: Scalar, u2: Scalar) -> Direction:
    """Normal drawn with `power_density` [Ashikhmin & Shirley 2000, eq. 9 and 10]."""
    x, y = jnp.sqrt(n_y + 1.0) * jnp.cos(2 * jnp.pi * u1), jnp.sqrt(n_x + 1.0) * jnp.sin(2 * jnp.pi * u1)
    length = jnp.sqrt(x * x + y * y)
    cos_p, sin_p = x / length, y / length
    log_cos = jnp.log1p(-u2) / (n_x * cos_p**2 + n_y * sin_p**2 + 1.0)
    sin_h = jnp.sqrt(-jnp.expm1(2.0 * log_cos))
    return Direction(sin_h * cos_p, sin_h * sin_p, jnp.exp(log_cos))


def power_widths(n_x: Scalar, n_y: Scalar) -> tuple[Scalar, Scalar]:
    """The slope widths 1/√(n+1) along x and y, by which the map of the lobe is stretched."""
    return 1.0 / jnp.sqrt(n_x + 1.0), 1.0 / jnp.sqrt(n_y + 1.0)
