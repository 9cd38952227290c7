"""The outgoing hemisphere by the slope of the facet that mirrors, in polar coordinates: smooth for half-vector lobes.

With the slope (α_x s cosψ, α_y s sinψ), its length ρs, and t = (α_x wi.x cosψ + α_y wi.y sinψ)/wi.z, a facet reflects
above the horizon when ρ²s² − 2ts − 1 < 0, so for s < (t + √(t² + ρ²))/ρ²: the range is explicit, and the integrand
analytic inside it.
"""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction, dot, reflect
from gonio.models.warps.grazing_azimuth import TANGENT_MAX, grazing_azimuth, polar_parts, rotated


class SlopeRay(NamedTuple):
    """One azimuth ψ of the slopes: the slope at s = 1, the s of the horizon, |dψ/du1|, and t above."""

    slope_x: Scalar
    slope_y: Scalar
    horizon: Scalar
    azimuth_rate: Scalar
    lean: Scalar


def slope_ray(wi: Direction, u1: Scalar, alpha_x: Scalar, alpha_y: Scalar) -> SlopeRay:
    """The ray of slopes at u1 in [0, 1], in units of the widths; wi on or above the horizon."""
    cos_i = jnp.maximum(wi.z, 1.0 / TANGENT_MAX)
    lean_most, cos_a, sin_a = polar_parts(Direction(alpha_x * wi.x / cos_i, alpha_y * wi.y / cos_i, wi.z))
    across = jnp.sqrt((alpha_x * sin_a) ** 2 + (alpha_y * cos_a) ** 2)
    cos_p, sin_p, azimuth_rate = grazing_azimuth(lean_most / across, u1)
    slope_x, slope_y = (a * c for a, c in zip((alpha_x, alpha_y), rotated(cos_a, sin_a, cos_p, sin_p), strict=True))
    length2 = slope_x**2 + slope_y**2
    lean = lean_most * cos_p
    root = jnp.sqrt(lean * lean + length2)
    horizon = jnp.where(lean >= 0, (lean + root) / length2, 1.0 / (root + jnp.abs(lean)))
    return SlopeRay(slope_x, slope_y, horizon, azimuth_rate, lean)


def facet_direction(
    wi: Direction, ray: SlopeRay, s: Scalar, radial_rate: Scalar, alpha_x: Scalar, alpha_y: Scalar
) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2) in sr) of the facet at s along a ray, where radial_rate = ds/du2."""
    m_z = 1.0 / jnp.sqrt(1.0 + s * s * (ray.slope_x**2 + ray.slope_y**2))
    m = Direction(s * ray.slope_x * m_z, s * ray.slope_y * m_z, m_z)
    jacobian = 4.0 * dot(wi, m) * m_z**3 * alpha_x * alpha_y * s * radial_rate * ray.azimuth_rate
    return reflect(wi, m), jacobian
