"""The outgoing hemisphere for volumes that scatter: f smooth in ln(μi + μo), and with a μ ln μ at the horizon."""

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import polar_parts

MU_MIN = 1e-30  # the least cosine of incidence: a safe operand, also in float32


def volume_map(wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)): equal steps of azimuth; μo + μi grows exponentially, with a slow start for μ ln μ at 0."""
    mu_i = jnp.maximum(wi.z, MU_MIN)
    _, cos_a, sin_a = polar_parts(wi)
    span = jnp.log1p(1.0 / mu_i)
    mu = jnp.minimum(mu_i * jnp.expm1(span * u2**3), 1.0)
    sin_t = jnp.sqrt((1.0 - mu) * (1.0 + mu))
    cos_p, sin_p = jnp.cos(2 * jnp.pi * u1), jnp.sin(2 * jnp.pi * u1)
    wo = Direction(sin_t * (cos_a * cos_p - sin_a * sin_p), sin_t * (sin_a * cos_p + cos_a * sin_p), mu)
    return wo, 2 * jnp.pi * (mu + mu_i) * span * 3.0 * u2**2
