"""The outgoing hemisphere in polar coordinates about the direction of incidence, for what peaks in retroreflection.

Along the azimuth ψ about wi (0 towards the normal) the phase angle g runs from 0 to the horizon's, where
cot g = −tan θi cosψ; the cone of a hot spot at g = 0 is smooth on each of these rays.
"""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import grazing_azimuth, grazing_tangent, polar_parts, rotated


class BackRay(NamedTuple):
    """One azimuth about wi: cosψ and sinψ, the phase angle of the horizon, |dψ/du1|, and sin θi cosψ."""

    cos_p: Scalar
    sin_p: Scalar
    horizon: Scalar
    azimuth_rate: Scalar
    rise: Scalar


def back_ray(wi: Direction, u1: Scalar) -> BackRay:
    """The ray at u1 in [0, 1]; wi on or above the horizon."""
    cos_p, sin_p, azimuth_rate = grazing_azimuth(grazing_tangent(wi), u1)
    rise = polar_parts(wi)[0] * cos_p
    return BackRay(cos_p, sin_p, jnp.arctan2(jnp.maximum(wi.z, 1e-12), -rise), azimuth_rate, rise)


def back_direction(wi: Direction, ray: BackRay, g: Scalar, radial_rate: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2) in sr) at the phase angle g along a ray, where radial_rate = dg/du2."""
    sin_i, cos_a, sin_a = polar_parts(wi)
    cos_g, sin_g = jnp.cos(g), jnp.sin(g)
    along, across = sin_g * ray.cos_p, sin_g * ray.sin_p
    out = cos_g * sin_i - along * wi.z
    wo = Direction(*rotated(cos_a, sin_a, out, across), cos_g * wi.z + along * sin_i)
    return wo, sin_g * radial_rate * ray.azimuth_rate


def grown(v: Scalar, length: Scalar, scale: Scalar) -> tuple[Scalar, Scalar]:
    """x in [0, length] and dx/dv for v in [0, 1]: x + scale grows exponentially, for what changes at that scale."""
    span = jnp.log1p(length / scale)
    return scale * jnp.expm1(span * v), scale * span * jnp.exp(span * v)


def hot_spot_map(wi: Direction, u1: Scalar, u2: Scalar, near: Scalar, far: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)): g resolved at the scale `near` about 0, and at `far` before the horizon, radians.

    The halves of u2 are those of the ray. Towards the horizon the cube of v absorbs a μo ln μo, or a power of μo.
    """
    ray = back_ray(wi, u1)
    half = 0.5 * ray.horizon
    inner = u2 < 0.5
    v = jnp.where(inner, 2.0 * u2, 2.0 * (1.0 - u2))
    start, start_rate = grown(v, half, near)
    end, end_rate = grown(v**3, half, far)
    g = jnp.where(inner, start, ray.horizon - end)
    return back_direction(wi, ray, g, 2.0 * jnp.where(inner, start_rate, 3.0 * v * v * end_rate))
