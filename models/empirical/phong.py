"""The Phong lobe, reciprocal and normalised."""

import jax.numpy as jnp
from jaxtyping import Array

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.geometry.guards import least_positive
from gonio.models.warps.grazing_azimuth import grazing_azimuth, grazing_tangent, polar_parts, rotated
from gonio.models.warps.radial_laws import S_MAX

EXPONENT = ParameterInfo(
    0.0, 1e6, "1", "exponent of the cosine about the mirror direction", start=30.0, role="exponent", log=True
)
Q2_MIN = 1e-36  # (cot β)² of a horizon further than any lobe reaches, above the least float32


class Phong(AbstractBRDF):
    """f = (n+2)/(2π) cosⁿβ, β from the mirror direction of wi [Phong 1975; Lafortune & Willems 1994].

    Without a cosine in the denominator, hence reciprocal. It reflects everything at normal incidence; a narrow lobe
    has the albedo cosθ_i elsewhere, and a wide one loses in addition what falls below the horizon.
    """

    lobe = True

    n: Channels = parameter(EXPONENT)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        ahead, log_cos = _log_cosine(wi, wo)
        return jnp.where(ahead, (self.n + 2.0) / (2 * jnp.pi) * jnp.exp(self.n * log_cos), 0.0)

    @property
    def mean_n(self) -> Scalar:
        """The exponent by which directions are drawn: the mean where channels differ."""
        return jnp.mean(self.n)

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        alpha = jnp.sqrt(1.0 / (self.mean_n + 2.0))
        return alpha, alpha

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """cosβ = (1 − u2)^(1/(n+1)) about the mirror direction, azimuth 2πu1 [Lafortune & Willems 1994]."""
        log_cos = jnp.log1p(-u2) / (self.mean_n + 1.0)
        return _about_mirror(wi, log_cos, jnp.cos(2 * jnp.pi * u1), jnp.sin(2 * jnp.pi * u1)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        """(n+1)/(2π) cosⁿβ, over the half sphere about the mirror direction."""
        inside, log_cos = _log_cosine(wi, wo)
        return jnp.where(inside, (self.mean_n + 1.0) / (2 * jnp.pi) * jnp.exp(self.mean_n * log_cos), 0.0)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """(β, ψ) about the mirror direction with cosβ = exp(−s²/(2(n+1))), s linear in u2 out to the horizon.

        The horizon is at cot β = tan θ_i |cosψ| where cosψ < 0, and beyond the lobe elsewhere.
        """
        n_1 = jnp.min(self.n) + 1.0  # the widest channel: the map must hold all of them
        tan_i = grazing_tangent(wi)
        cos_p, sin_p, azimuth_rate = grazing_azimuth(tan_i, u1)
        q2 = jnp.maximum((tan_i * jnp.minimum(cos_p, 0.0)) ** 2, Q2_MIN)
        s_max = jnp.minimum(jnp.sqrt(n_1 * jnp.log1p(1.0 / q2)), S_MAX)
        s = s_max * u2
        log_cos = -0.5 * s * s / n_1
        return _about_mirror(wi, log_cos, cos_p, sin_p), jnp.exp(log_cos) * s / n_1 * s_max * azimuth_rate


def _log_cosine(wi: Direction, wo: Direction) -> tuple[Array, Scalar]:
    # Whether wo is within 90° of the mirror direction, and log cosβ: near it from |mirror − wo|², which keeps its
    # digits where n is large and β small; far from it from the cosine itself, which keeps its own (XLA's log1p is off
    # by 3e-14 from −0.41 to −0.3 on the CPU).
    d2 = (wi.x + wo.x) ** 2 + (wi.y + wo.y) ** 2 + (wi.z - wo.z) ** 2
    cosine = wi.z * wo.z - wi.x * wo.x - wi.y * wo.y
    near, ahead = d2 < 0.5, cosine > 0
    # The least cosine, not 1, where it is not ahead: a compiler may round the two uses of it apart, about 0.
    far = jnp.log(least_positive(jnp.where(near, 1.0, cosine)))
    return ahead, jnp.where(near, jnp.log1p(-0.5 * jnp.where(near, d2, 0.0)), far)


def _about_mirror(wi: Direction, log_cos: Scalar, cos_p: Scalar, sin_p: Scalar) -> Direction:
    # The direction at β from the mirror direction of wi, ψ = 0 towards the normal.
    sin_i, cos_a, sin_a = polar_parts(wi)
    cos_b = jnp.exp(log_cos)
    sin2_b = -jnp.expm1(2.0 * log_cos)
    away = sin2_b > 0
    sin_b = jnp.where(away, jnp.sqrt(jnp.where(away, sin2_b, 1.0)), 0.0)
    along, across = sin_b * cos_p, sin_b * sin_p
    # The mirror's azimuth is (−cos_a, −sin_a).
    tangent = along * wi.z - cos_b * sin_i
    return Direction(*rotated(cos_a, sin_a, tangent, across), cos_b * wi.z + along * sin_i)
