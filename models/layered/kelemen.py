"""The coupled specular and matte model of Kelemen and Szirmay-Kalos."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, AbstractComposite, Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.fresnel import fresnel_schlick1994
from gonio.models.geometry.half_vector import half_angles
from gonio.models.microfacet import albedo_tables as tables
from gonio.models.microfacet import base as mf
from gonio.models.microfacet import distributions as slopes
from gonio.models.microfacet.energy_compensation import cosine_layer_map
from gonio.models.microfacet.widths import AbstractGaussianFacets

RHO = ParameterInfo(0.0, 1.0, "1", "albedo of the matte part", start=0.5, role="albedo", per_channel=True)


class KelemenLobe(AbstractGaussianFacets):
    """f = F D/|i + o|² with Beckmann's D and Schlick's F [Kelemen & Szirmay-Kalos 2001]."""

    alpha: Channels
    f0: Channels

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        floor = float(jnp.finfo(jnp.result_type(wi.z)).tiny) ** 0.2
        opposite = sum((a + b) ** 2 for a, b in zip(wi, wo, strict=True)) < (2.0 * floor) ** 2
        # 1/cos²θ_d has no gradient that can be written down there (5e-62; 3e-8 in single precision).
        wi, wo = (Direction(*(jnp.where(opposite, jax.lax.stop_gradient(c), c) for c in w)) for w in (wi, wo))
        h, cos_d, _ = half_angles(wi, wo)
        density = slopes.beckmann_d(h, self.alpha, self.alpha)
        return 0.25 * fresnel_schlick1994(cos_d, self.f0) * density / jnp.maximum(cos_d, floor) ** 2


class KelemenMatte(AbstractBRDF):
    """f = ρ (1 − E(μi))(1 − E(μo))/(π(1 − E_avg)), E the albedo of `KelemenLobe`, by our own integrals.

    F = 1 − (1 − f0)(1 − (1 − d)⁵), so 1 − E = M + (1 − f0) G with two tables: M = 1 − E of F = 1, and G, how much
    less F = (1 − d)⁵ reflects.
    """

    rho: Channels
    alpha: Channels
    f0: Channels

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        white, grazing = (tables.width_series(name, self.alpha) for name in ("kelemen_white", "kelemen_grazing"))

        def missing(of: Callable[[str, tables.Series], Channels]) -> Channels:
            return of("kelemen_white", white) + (1.0 - self.f0) * of("kelemen_grazing", grazing)

        m_i, m_o = (missing(lambda n, s, w=w: tables.tabulated(n, s, w.z, self.alpha)) for w in (wi, wo))
        average = missing(lambda n, s: tables.average(n, s, self.alpha))
        return self.rho / average * (m_i * m_o) / jnp.pi

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return cosine_layer_map(tables.KINDS["kelemen_white"].cosines, jnp.mean(self.alpha), wi, u1, u2)


class Kelemen(AbstractComposite):
    """f = F D/|i + o|² + ρ (1 − E(μi))(1 − E(μo))/(π(1 − E_avg)) [Kelemen & Szirmay-Kalos 2001], |i + o| = 2 cosθ_d.

    Beckmann's D, Schlick's F; E is the albedo of the first term: what it does not reflect falls on the matte part, so
    that ρ = 1 reflects everything. Reciprocal.
    """

    rho: Channels = parameter(RHO)
    alpha: Channels = parameter(mf.ALPHA)
    f0: Channels = parameter(mf.F0)

    def terms(self) -> tuple[AbstractBRDF, ...]:
        return KelemenLobe(self.alpha, self.f0), KelemenMatte(self.rho, self.alpha, self.f0)

    @property
    def accuracy(self) -> float:
        return 4e-7
