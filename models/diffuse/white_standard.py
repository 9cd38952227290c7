"""An exact standard of reflection 1."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, Scalar
from gonio.models.warps.hemisphere import volume_map

MISSING = 0.5908629074132604  # 1 − E_avg = (4 ln 2 − 1)/3


def lost(mu: Scalar) -> Scalar:
    """R(μ) = μ ln(1 + 1/μ), what mirror facets with GGX slopes of α = 1 do not reflect at once; μ > 0."""
    return mu * (jnp.log1p(mu) - jnp.log(mu))


class WhiteStandard(AbstractBRDF):
    """f = 1/(2π(μi + μo)) + R(μi)R(μo)/(π(1 − E_avg)): reciprocal, of albedo 1 at every incidence.

    GGX of α = 1 with F = 1 and height-correlated Smith masking, whose albedo is 1 − R(μ), completed
    as in [Kulla & Conty 2017, "Revisiting physically based shading"]. A standard to judge integrals
    and instruments by.
    """

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return (0.5 / (wi.z + wo.z) + lost(wi.z) * lost(wo.z) / MISSING) / jnp.pi

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return volume_map(wi, u1, u2)
