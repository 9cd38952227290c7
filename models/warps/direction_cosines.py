"""The outgoing hemisphere by its projection on the unit disc, in polar coordinates about the mirror direction.

In direction cosines β = (x, y) the measure cosθ dω is dβ, and a lobe that depends on ρ = |β − β₀| = |(wi.x + wo.x,
wi.y + wo.y)| is the same at every incidence; only the rim cuts it. About β₀, at sin θ_i from the centre, the rim stands
at ρ = cos θ_i (√(1 + t²) − t), t = tan θ_i cosψ, where ψ = 0 points away from the normal.
"""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import grazing_azimuth, grazing_tangent, polar_parts, rotated


def projected_distance2(wi: Direction, wo: Direction) -> Scalar:
    """|β − β₀|², the squared distance of `wo` from the mirror direction of `wi` in direction cosines."""
    return (wi.x + wo.x) ** 2 + (wi.y + wo.y) ** 2


class DiscRay(NamedTuple):
    """One azimuth ψ about the mirror direction: cosψ, sinψ, the rim's ρ and ρ·(other root), and |dψ/du1|."""

    cos_p: Scalar
    sin_p: Scalar
    rim: Scalar
    behind: Scalar
    azimuth_rate: Scalar


def disc_ray(wi: Direction, u1: Scalar) -> DiscRay:
    """The ray at u1 in [0, 1], its azimuths clustered where a grazing rim turns quickly."""
    tan_i = grazing_tangent(wi)
    cos_p, sin_p, azimuth_rate = grazing_azimuth(tan_i, u1)
    return _ray(wi, tan_i, cos_p, sin_p, azimuth_rate)


def uniform_ray(wi: Direction, u1: Scalar) -> DiscRay:
    """The ray at the azimuth ψ = 2πu1."""
    angle = 2 * jnp.pi * u1
    return _ray(wi, grazing_tangent(wi), jnp.cos(angle), jnp.sin(angle), jnp.full_like(angle, 2 * jnp.pi))


def _ray(wi: Direction, tan_i: Scalar, cos_p: Scalar, sin_p: Scalar, azimuth_rate: Scalar) -> DiscRay:
    t = tan_i * cos_p
    root = jnp.sqrt(1.0 + t * t)
    long, short = root + jnp.abs(t), 1.0 / (root + jnp.abs(t))
    cos_i = jnp.maximum(wi.z, 0.0)
    return DiscRay(
        cos_p, sin_p, cos_i * jnp.where(t > 0, short, long), cos_i * jnp.where(t > 0, long, short), azimuth_rate
    )


def disc_direction(wi: Direction, ray: DiscRay, rho: Scalar) -> Direction:
    """The direction at ρ in [0, rim] of a ray; its cosine keeps its digits at the rim."""
    sin_i, cos_a, sin_a = polar_parts(wi)
    along, across = sin_i + rho * ray.cos_p, rho * ray.sin_p
    z2 = jnp.maximum((ray.rim - rho) * (ray.behind + rho), 0.0)
    up = z2 > 0
    z = jnp.where(up, jnp.sqrt(jnp.where(up, z2, 1.0)), 0.0)
    return Direction(*rotated(cos_a, sin_a, -along, -across), z)


def disc_jacobian(wo: Direction, rho: Scalar, radial_rate: Scalar, ray: DiscRay) -> Scalar:
    """dω/(du1 du2), sr, where radial_rate = dρ/du2."""
    return rho * radial_rate * ray.azimuth_rate / jnp.maximum(wo.z, 1e-30)


def rim_towards(wi: Direction, wo: Direction) -> Scalar:
    """ρ of the rim on the ray from the mirror direction through `wo`."""
    b_x, b_y = wi.x + wo.x, wi.y + wo.y
    rho2 = b_x * b_x + b_y * b_y
    away = rho2 > 0
    rho = jnp.sqrt(jnp.where(away, rho2, 1.0))
    # sin θ_i cosψ, the mirror direction's own cosines being (−wi.x, −wi.y).
    outwards = jnp.where(away, -(wi.x * b_x + wi.y * b_y) / rho, 0.0)
    root = jnp.sqrt(jnp.maximum(outwards * outwards + wi.z * wi.z, 1e-30))
    return jnp.where(outwards > 0, wi.z * wi.z / (root + jnp.abs(outwards)), root + jnp.abs(outwards))
