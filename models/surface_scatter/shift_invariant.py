"""Lobes of the distance from the mirror direction in direction cosines: the same at every incidence [Harvey 1976]."""

import abc
from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Direction, Sample, Scalar
from gonio.models.special.exprel import exprel
from gonio.models.warps.direction_cosines import (
    disc_direction,
    disc_jacobian,
    disc_ray,
    projected_distance2,
    rim_towards,
    uniform_ray,
)


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

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return self.disc_map(wi, u1, u2, self.drawn_core(wi)[0])

    def disc_map(self, wi: Direction, u1: Scalar, u2: Scalar, width: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the unit disc about the mirror direction, out to the rim, for a core of this width."""
        ray = disc_ray(wi, u1)
        x_max = jnp.arcsinh(jnp.minimum(ray.rim / width, self.reach))
        x = x_max * u2 * (2.0 - u2)
        rho = jnp.minimum(width * jnp.sinh(x), ray.rim)
        wo = disc_direction(wi, ray, rho)
        return wo, disc_jacobian(wo, rho, width * jnp.cosh(x) * (2.0 * x_max * (1.0 - u2)), ray)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        width, fall = self.drawn_core(wi)
        ray = uniform_ray(wi, u1)
        log_max = jnp.log1p((ray.rim / width) ** 2)
        y = (1.0 - fall) * log_max
        small = jnp.abs(y) < 1e-4
        safe = jnp.where(small, 1.0, y)
        share = jnp.where(small, u2 + 0.5 * y * u2 * (1.0 - u2), jnp.log1p(u2 * jnp.expm1(safe)) / safe)
        stretched = jnp.maximum(jnp.expm1(log_max * share), 0.0)
        rho = width * jnp.where(stretched > 0, jnp.sqrt(jnp.where(stretched > 0, stretched, 1.0)), 0.0)
        return disc_direction(wi, ray, jnp.minimum(rho, ray.rim)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        width, fall = self.drawn_core(wi)
        log_max = jnp.log1p((rim_towards(wi, wo) / width) ** 2)
        whole = jnp.maximum(log_max * exprel((1.0 - fall) * log_max), 1e-30)
        shape = jnp.exp(-fall * jnp.log1p(projected_distance2(wi, wo) / width**2))
        return jnp.maximum(wo.z, 0.0) * shape / (jnp.pi * width**2 * whole)
