"""Maps of the unit square onto the outgoing hemisphere for what has no lobe."""

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.warps.grazing_azimuth import polar_parts, rotated

MU_MIN = 1e-30  # the least cosine of incidence: a safe operand, also in float32


def cosine_sample(u1: Scalar, u2: Scalar) -> Direction:
    """Direction of density cosθ/π from (u1, u2) in [0, 1)²: u1 is the azimuth in turns, sin²θ = u2 [Malley]."""
    phi = 2 * jnp.pi * u1
    sin_t = jnp.sqrt(u2)
    return Direction(sin_t * jnp.cos(phi), sin_t * jnp.sin(phi), jnp.sqrt(1.0 - u2))


def cosine_pdf(wo: Direction) -> Scalar:
    """Density of `cosine_sample`, 1/sr; 0 below the horizon."""
    return jnp.maximum(wo.z, 0.0) / jnp.pi


def polar_map(u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)) with θ = πu2/2 and φ = 2πu1; the cosine's own map has roots of u2 at both ends."""
    wo = from_spherical(0.5 * jnp.pi * u2, 2 * jnp.pi * u1)
    return wo, jnp.pi**2 * jnp.sin(0.5 * jnp.pi * u2)


def beside(wi: Direction, u1: Scalar, sin_t: Scalar, cos_t: Scalar) -> Direction:
    """The direction of polar angle θ whose azimuth is that of wi plus 2πu1."""
    _, cos_a, sin_a = polar_parts(wi)
    x, y = rotated(cos_a, sin_a, jnp.cos(2 * jnp.pi * u1), jnp.sin(2 * jnp.pi * u1))
    return Direction(sin_t * x, sin_t * y, cos_t)


def rough_diffuser_map(wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)) cut where a rough diffuser has its kinks: at ±90° from the azimuth of wi, and at θo = θi."""
    theta_i = jnp.arctan2(polar_parts(wi)[0], wi.z)
    low, rest = 2.0 * theta_i, jnp.pi - 2.0 * theta_i
    inner = u2 < 0.5
    theta = jnp.where(inner, low * u2, theta_i + rest * (u2 - 0.5))
    sin_t = jnp.sin(theta)
    return beside(wi, u1, sin_t, jnp.cos(theta)), 2 * jnp.pi * sin_t * jnp.where(inner, low, rest)


def volume_map(wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)) for volumes that scatter: f is smooth in ln(μi + μo), and has a μ ln μ at the horizon.

    Equal steps of azimuth; μo + μi grows exponentially, with a slow start for μ ln μ at 0.
    """
    mu_i = jnp.maximum(wi.z, MU_MIN)
    span = jnp.log1p(1.0 / mu_i)
    mu = jnp.minimum(mu_i * jnp.expm1(span * u2**3), 1.0)
    sin_t = jnp.sqrt((1.0 - mu) * (1.0 + mu))
    return beside(wi, u1, sin_t, mu), 2 * jnp.pi * (mu + mu_i) * span * 3.0 * u2**2
