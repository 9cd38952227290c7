"""Rough diffusers: Fujii's form of the Oren–Nayar model, and its energy-preserving completion."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.diffuse.lambert import ALBEDO
from gonio.models.warps.grazing_azimuth import polar_parts
from gonio.models.warps.hemisphere import rough_diffuser_map

# Portsmouth, Kutz & Hill 2024 (arXiv 2410.18026), their constants c1 and c2 of the average albedo.
C1 = 0.5 - 2 / (3 * jnp.pi)
C2 = 2 / 3 - 28 / (15 * jnp.pi)

SINGLE_ALBEDO = ParameterInfo(
    0.0, 1.0, "1", "albedo of a single scattering", start=0.5, role="albedo", per_channel=True
)
ROUGHNESS = ParameterInfo(0.0, 1.0, "1", "share of roughness: 0 is Lambert", start=0.5, role="roughness")


def _fujii_shape(wi: Direction, wo: Direction, r: Scalar) -> Scalar:
    # π f/ρ = A (1 + r s/t) [Portsmouth, Kutz & Hill 2024], for directions above the horizon. Where s < 0, t is 1 and
    # 1 + s = (|wi + wo|² in the plane + wi.z² + wo.z²)/2 of unit vectors, which does not cancel at grazing.
    s = wi.x * wo.x + wi.y * wo.y
    forward = s > 0
    t = jnp.where(forward, jnp.maximum(wi.z, wo.z), 1.0)
    remainder = 0.5 * ((wi.x + wo.x) ** 2 + (wi.y + wo.y) ** 2 + (wi.z + wo.z) ** 2) - wi.z * wo.z
    return jnp.where(forward, 1.0 + r * (s / t), (1.0 - r) + r * remainder) / (1.0 + C1 * r)


def fujii_g(w: Direction) -> Scalar:
    """G(θ) of the albedo A + (rA/π)G of Fujii's model with ρ = 1 [Portsmouth, Kutz & Hill 2024].

    In terms of μ and S = sin θ with (1 − S³)/μ multiplied out, so that grazing needs no limit.
    Exact, where renderers take a polynomial: energy is then conserved to rounding, at the price of
    one arctangent.
    """
    mu, (sin_t, _, _) = w.z, polar_parts(w)
    theta = jnp.arctan2(sin_t, mu)
    inner = mu * (1.0 + sin_t + sin_t**2) / (1.0 + sin_t) - 1.0
    return sin_t * (theta - sin_t * mu) + 2.0 / 3.0 * sin_t * inner


class FujiiOrenNayar(AbstractBRDF):
    """f = ρ/π A (1 + r s/t), Fujii's qualitative Oren–Nayar [as in Portsmouth, Kutz & Hill 2024].

    s = wi·wo − cosθi cosθo; t is the larger cosine where s > 0, and 1 elsewhere; A = 1/(1 + c1 r). It loses
    energy as r grows: `EON` gives back what is scattered more than once.
    """

    rho: Channels = parameter(ALBEDO)
    r: Channels = parameter(ROUGHNESS)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.rho / jnp.pi * _fujii_shape(wi, wo, self.r)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return rough_diffuser_map(wi, u1, u2)


class EON(AbstractBRDF):
    """Energy-preserving Oren–Nayar [Portsmouth, Kutz & Hill 2024]: with ρ = 1 it reflects everything.

    Fujii's f for single scattering, and (ρ_ms/π)(1−Ê(μi))(1−Ê(μo))/(1−⟨Ê⟩) for the rest, with
    ρ_ms = ρ²⟨Ê⟩/(1 − ρ(1−⟨Ê⟩)), Ê the albedo of Fujii's model at ρ = 1.
    """

    rho: Channels = parameter(SINGLE_ALBEDO)
    r: Channels = parameter(ROUGHNESS)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        rho, r = self.rho, self.r
        a = 1.0 / (1.0 + C1 * r)
        # 1 − Ê = rA(c1 − G/π) and 1 − ⟨Ê⟩ = rA(c1 − c2): with rA cancelled, r = 0 is no special case.
        missing = (C1 - fujii_g(wi) / jnp.pi) * (C1 - fujii_g(wo) / jnp.pi) / (C1 - C2)
        average = a * (1.0 + C2 * r)
        rho_ms = rho**2 * average / (1.0 - rho * (r * a * (C1 - C2)))
        return (rho * _fujii_shape(wi, wo, r) + rho_ms * (r * a) * missing) / jnp.pi

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return rough_diffuser_map(wi, u1, u2)
