"""The outgoing hemisphere by its projection on the unit disc, in polar coordinates about the mirror direction.

In direction cosines β = (x, y) the measure cosθ dω is dβ, and a lobe that depends on ρ = |β − β₀| = |(wi.x + wo.x,
wi.y + wo.y)| is the same at every incidence; only the rim cuts it. About β₀, at sin θ_i from the centre, the rim stands
at ρ = cos θ_i (√(1 + t²) − t), t = tan θ_i cosψ, where ψ = 0 points away from the normal.
"""

import abc
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import grazing_azimuth, grazing_tangent, polar_parts

Scalar = Float[Array, "..."]


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


def _ray(wi, tan_i, cos_p, sin_p, azimuth_rate) -> DiscRay:
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
    return Direction(-along * cos_a + across * sin_a, -along * sin_a - across * cos_a, z)


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


def _exp_ratio(y: Scalar) -> Scalar:
    """(eʸ − 1)/y, 1 at 0."""
    small = jnp.abs(y) < 1e-4
    safe = jnp.where(small, 1.0, y)
    return jnp.where(small, 1.0 + 0.5 * y * (1.0 + y / 3.0), jnp.expm1(safe) / safe)


class AbstractDiscLobe(AbstractBRDF):
    """A lobe of the distance ρ in direction cosines, about (1 + ρ²/w²)^(−c) with the w and c that a final class names.

    Its map has ρ = w sinh x, so that core and power tail both get their share, and x as a square at the rim, where
    cosθo then falls linearly: f may be as steep as 1/cosθo. Samples have the density (1 + ρ²/w²)^(−c) on each ray, the
    rays at equal steps of azimuth.
    """

    reach: ClassVar[float] = 1e30
    """The ρ, in widths, beyond which the lobe is below rounding."""

    @abc.abstractmethod
    def core(self, wi: Direction) -> tuple[Scalar, Scalar]:
        """(w, c): the width of the core in direction cosines, above 0, and half of the tail's exponent."""

    def drawn_core(self, wi: Direction) -> tuple[Scalar, Scalar]:
        """`core` without channels: the least width, as beyond a core the map resolves everything, inside it nothing."""
        width, fall = self.core(wi)
        return jnp.clip(jnp.min(width), 1e-8, 10.0), jnp.mean(fall)

    def lobe_map(self, wi, u1, u2):
        return self.disc_map(wi, u1, u2, self.drawn_core(wi)[0])

    def disc_map(self, wi: Direction, u1: Scalar, u2: Scalar, width: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the unit disc about the mirror direction, out to the rim, for a core of this width."""
        ray = disc_ray(wi, u1)
        x_max = jnp.arcsinh(jnp.minimum(ray.rim / width, self.reach))
        x = x_max * u2 * (2.0 - u2)
        rho = jnp.minimum(width * jnp.sinh(x), ray.rim)
        wo = disc_direction(wi, ray, rho)
        return wo, disc_jacobian(wo, rho, width * jnp.cosh(x) * (2.0 * x_max * (1.0 - u2)), ray)

    def sample(self, wi, u1, u2):
        width, fall = self.drawn_core(wi)
        ray = uniform_ray(wi, u1)
        log_max = jnp.log1p((ray.rim / width) ** 2)
        y = (1.0 - fall) * log_max
        small = jnp.abs(y) < 1e-4
        safe = jnp.where(small, 1.0, y)
        share = jnp.where(small, u2 + 0.5 * y * u2 * (1.0 - u2), jnp.log1p(u2 * jnp.expm1(safe)) / safe)
        stretched = jnp.maximum(jnp.expm1(log_max * share), 0.0)
        rho = width * jnp.where(stretched > 0, jnp.sqrt(jnp.where(stretched > 0, stretched, 1.0)), 0.0)
        return disc_direction(wi, ray, jnp.minimum(rho, ray.rim))

    def pdf(self, wi, wo):
        width, fall = self.drawn_core(wi)
        log_max = jnp.log1p((rim_towards(wi, wo) / width) ** 2)
        whole = jnp.maximum(log_max * _exp_ratio((1.0 - fall) * log_max), 1e-30)
        shape = jnp.exp(-fall * jnp.log1p(projected_distance2(wi, wo) / width**2))
        return jnp.maximum(wo.z, 0.0) * shape / (jnp.pi * width**2 * whole)
