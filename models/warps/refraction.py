"""Slopes of the facets that refract, in polar coordinates about the mean normal, with the range of every azimuth.

A facet of normal m ∝ (p, 1) refracts light of direction i, above it, from index n_i into n_o = n_i/r. With
k = 1 − 1/r² and c = i·m, it does so where c > 0 and c² > k (no total reflection), and where the refracted direction is
below the mean surface. Along a ray p = s d with u = i·d, ρ = |d|, z = i.z the range of s is explicit: the cone of total
reflection cuts the plane of slopes in a conic, and the horizon of what is refracted cuts it in a circle that touches
the conic twice; both discriminants hold E = u² − ρ²(k − z²).
"""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import TANGENT_MAX, polar_parts, rotated
from gonio.models.warps.slopes import slope_ray


class RefractionRay(NamedTuple):
    """One azimuth of the slopes: the slope at s = 1, the range of s (`high` may be infinite), and |dψ/du1|."""

    slope_x: Scalar
    slope_y: Scalar
    low: Scalar
    high: Scalar
    azimuth_rate: Scalar


def refraction_ray(wi: Direction, u1: Scalar, alpha_x: Scalar, alpha_y: Scalar, k: Scalar) -> RefractionRay:
    """The ray at u1 in [0, 1], s in units of the widths; wi above the surface, k = 1 − (n_o/n_i)²."""
    z = jnp.maximum(wi.z, 1.0 / TANGENT_MAX)
    # Where the mean surface itself reflects all, only azimuths about that of wi refract.
    beyond = k - z * z
    total = beyond > 0
    depth = jnp.sqrt(jnp.where(total, 1.0, jnp.where(k > 0, -beyond, z * z)))
    open_ray = slope_ray(Direction(wi.x, wi.y, depth), u1, alpha_x, alpha_y)
    closed = _wedge(wi, u1, alpha_x, alpha_y, jnp.where(total, beyond, 0.0))
    slope_x, slope_y, azimuth_rate = (
        jnp.where(total, c, o)
        for c, o in zip(closed, (open_ray.slope_x, open_ray.slope_y, open_ray.azimuth_rate), strict=True)
    )
    u, length2 = slope_x * wi.x + slope_y * wi.y, slope_x**2 + slope_y**2
    dense = k > 0
    e = jnp.sqrt(jnp.maximum(u * u - length2 * jnp.where(dense, beyond, 0.0), 1e-300**0.5))
    root = jnp.sqrt(jnp.where(dense, k, 1.0)) * e
    # (numerator, denominator) of the end of the range; a denominator that is not positive: there is none.
    over = jnp.where(dense, jnp.where(total, z * u + root, -beyond), z)
    under = jnp.where(dense, jnp.where(total, k * length2 - u * u, root - z * u), -u)
    high = jnp.where(under > 0, over / jnp.where(under > 0, under, 1.0), jnp.inf)
    low = jnp.where(total, beyond / (z * jnp.where(total, u + e, 1.0)), 0.0)
    return RefractionRay(slope_x, slope_y, jnp.minimum(low, high), high, azimuth_rate)


def _wedge(
    wi: Direction, u1: Scalar, alpha_x: Scalar, alpha_y: Scalar, beyond: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """(slope_x, slope_y, |dψ/du1|) where azimuths within arccos(√beyond/sin θi) of wi refract: denser at both ends."""
    sin_i, cos_a, sin_a = polar_parts(wi)
    half = jnp.arccos(jnp.clip(jnp.sqrt(beyond) / jnp.maximum(sin_i, 1e-12), 0.0, 1.0))
    turn = jnp.pi * (u1 - 0.5)
    beta = half * jnp.sin(turn)
    x, y = rotated(cos_a, sin_a, jnp.cos(beta), jnp.sin(beta))
    length = 1.0 / jnp.sqrt((x / alpha_x) ** 2 + (y / alpha_y) ** 2)
    return length * x, length * y, length**2 / (alpha_x * alpha_y) * (half * jnp.pi * jnp.cos(turn))
