"""Blinn's lobe: a power of the cosine between half vector and normal."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.empirical.cosine_power import power_density, power_normal, power_widths
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.half_vector import half_angles, log_cosine, mirrored_pdf
from gonio.models.warps.radial_laws import power_reach, power_slope
from gonio.models.warps.slopes import facet_direction, slope_ray

EXPONENT = ParameterInfo(
    0.0, 1e6, "1", "exponent of the cosine between half vector and normal", start=60.0, role="exponent", log=True
)


class AbstractBlinnPhong(AbstractBRDF):
    """A factor that depends on n alone, times cosⁿθ_h."""

    lobe = True
    n: eqx.AbstractVar[Channels]

    @abc.abstractmethod
    def factor(self) -> Channels:
        """What multiplies the power, 1/sr."""

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return power_widths(jnp.mean(self.n), jnp.mean(self.n))

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h, _, sin2_h = half_angles(wi, wo)
        return self.factor() * jnp.exp(self.n * log_cosine(h, sin2_h))

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        n = jnp.mean(self.n)
        return reflect(wi, power_normal(n, n, u1, u2)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        n = jnp.mean(self.n)
        return mirrored_pdf(lambda m: power_density(m, n, n), wi, wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope, Gaussian in the radius, out to the horizon's."""
        n = jnp.min(self.n)  # the widest channel: the map must hold all of them
        widths = power_widths(n, n)
        ray = slope_ray(wi, u1, *widths)
        length2 = ray.slope_x**2 + ray.slope_y**2
        reach = power_reach(length2, ray.horizon)
        s, rate = power_slope(length2, reach * u2)
        return facet_direction(wi, ray, s, rate * reach, *widths)


class BlinnPhong(AbstractBlinnPhong):
    """f = (n+2)(n+4)/(8π(2^(−n/2) + n)) cosⁿθ_h: normalised Blinn–Phong [Blinn 1977; Giesen 2009].

    It reflects everything at normal incidence, and loses towards grazing: a narrow lobe has the albedo cosθ_i.
    """

    loses_energy = "A narrow lobe has the albedo cosθ_i: nothing is left at grazing."

    n: Channels = parameter(EXPONENT)

    def factor(self) -> Channels:
        n = self.n
        return (n + 2.0) * (n + 4.0) / (8 * jnp.pi * (jnp.exp2(-0.5 * n) + n))


class BlinnPhongPopular(AbstractBlinnPhong):
    """f = (n+8)/(8π) cosⁿθ_h: Blinn–Phong with the rounded factor that renderers made popular [Akenine-Möller,
    Haines & Hoffman 2008, §7.6]."""

    violates: ClassVar = {"energy": "It gains 7.5 % at normal incidence where n is 9 (2.4 % at n = 1, 1.8 % at 100)."}

    n: Channels = parameter(EXPONENT)

    def factor(self) -> Channels:
        return (self.n + 8.0) / (8 * jnp.pi)
