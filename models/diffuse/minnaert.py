"""Minnaert's law of limb darkening."""

from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.diffuse.lambert import ALBEDO
from gonio.models.geometry.guards import positive

LIMB = ParameterInfo(0.0, 5.0, "1", "limb darkening: 1 is Lambert, 0.5 the full moon", start=1.0, role="exponent")


class Minnaert(AbstractBRDF):
    """f = ρ (k+1)/(2π) (μi μo)^(k−1): powers of the cosines that keep reciprocity [Minnaert 1941].

    ρ is the albedo at normal incidence; elsewhere it is ρ μ^(k−1).
    """

    violates: ClassVar = {"energy": "its albedo is ρ μ^(k−1): for k < 1 it exceeds 1 near grazing, without a limit"}

    rho: Channels = parameter(ALBEDO)
    k: Channels = parameter(LIMB)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        limb_i, limb_o = (jnp.power(positive(w.z), self.k - 1.0) for w in (wi, wo))
        return self.rho * (self.k + 1.0) / (2 * jnp.pi) * (limb_i * limb_o)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """Density (k+1)/(2π) μᵏ, which is f cosθ over its albedo: μ = (1 − u2)^(1/(k+1))."""
        return _polar(u1, jnp.log1p(-u2) / (jnp.mean(self.k) + 1.0)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        k = jnp.mean(self.k)
        up = wo.z > 0
        return jnp.where(up, (k + 1.0) / (2 * jnp.pi) * jnp.power(jnp.where(up, wo.z, 1.0), k), 0.0)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """μᵏ⁺¹ = u2³, or u2⁶ for k > 2, k the least of the channels: f μ Jacobian is a polynomial where they agree."""
        k_1 = jnp.min(self.k) + 1.0
        power = 3.0 * jnp.ceil(k_1 / 3.0) / k_1
        log_mu = power * jnp.log(u2)
        return _polar(u1, log_mu), 2 * jnp.pi * power * jnp.exp(log_mu) / u2


def _polar(u1: Scalar, log_mu: Scalar) -> Direction:
    sin2 = -jnp.expm1(2.0 * log_mu)
    away = sin2 > 0
    sin_t = jnp.where(away, jnp.sqrt(jnp.where(away, sin2, 1.0)), 0.0)
    phi = 2 * jnp.pi * u1
    return Direction(sin_t * jnp.cos(phi), sin_t * jnp.sin(phi), jnp.exp(log_mu))
