"""An exact standard of reflection 1."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from gonio.models.brdf import AbstractBRDF
from gonio.models.warps.volume import volume_map

Scalar = Float[Array, "..."]

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

    def f(self, wi, wo):
        above = (wi.z > 0) & (wo.z > 0)
        mu_i, mu_o = jnp.where(above, wi.z, 1.0), jnp.where(above, wo.z, 1.0)
        value = 0.5 / (mu_i + mu_o) + lost(mu_i) * lost(mu_o) / MISSING
        return jnp.where(above, value / jnp.pi, 0.0)

    def lobe_map(self, wi, u1, u2):
        return volume_map(wi, u1, u2)
