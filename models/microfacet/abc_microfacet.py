"""Löw's microfacet lobe: the ABC law of smooth-surface scatter, put on the half vector."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.fresnel import fresnel_of
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import half_angles, mirrored_pdf
from gonio.models.microfacet import base as mf
from gonio.models.microfacet.distributions import ggx_d, ggx_normal
from gonio.models.microfacet.v_cavity import v_cavity_map, v_cavity_visibility
from gonio.models.warps.radial_laws import power_law

B = ParameterInfo(
    0.0, 1e7, "1", "inverse width: S falls where 1 − cosθ_h exceeds 1/b", start=1000.0, role="inverse_width"
)
C = ParameterInfo(0.01, 10.0, "1", "exponent with which S falls", start=1.0, role="exponent", log=True)
ETA = dataclasses.replace(mf.ETA, high=200.0)  # published fits of metals go to 100


class ABCMicrofacet(AbstractBRDF):
    """f = F S G/(cosθi cosθo), S = (1 + b(1 − cosθ_h))^(−c), the G of V-cavities [Löw et al. 2012, eq. 15].

    The paper's A is the scale of the term. `f0`, or `eta` (and `k`), or none (F = 1). Löw's published fits were made
    with F S G/(π cosθi cosθo).
    """

    lobe = True
    violates: ClassVar = {"energy": "S is not normalised: of scale 1, it reflects 4.7 at normal incidence for b = 0."}

    b: Channels = parameter(B)
    c: Channels = parameter(C)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        half = half_angles(wi, wo)
        fall = half.sin2_h / (1.0 + half.h.z)  # 1 − cosθ_h
        s = jnp.exp(-self.c * jnp.log1p(self.b * fall))
        return fresnel_of(self, positive(half.cos_d)) * s * v_cavity_visibility(wi, wo, half)

    @property
    def width(self) -> Scalar:
        """The slope at which S begins to fall, at most 1: 1 − cosθ_h is half of its square."""
        return jnp.sqrt(2.0 / jnp.maximum(jnp.mean(self.b) * jnp.maximum(jnp.mean(self.c), 1.0), 2.0))

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return self.width, self.width

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """wi mirrored in a facet of GGX slopes of the same width, which S of c = 2 has."""
        return reflect(wi, ggx_normal(self.width, u1, u2)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return mirrored_pdf(lambda m: ggx_d(m, self.width, self.width) * m.z, wi, wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope, cut at the kinks of G and where S is below 1e-18/(1 + b)."""
        b, c = jnp.mean(self.b), jnp.min(self.c)
        fall = jnp.expm1(jnp.minimum((41.0 + jnp.log1p(b)) / c, 60.0)) / jnp.maximum(b, 1e-30)
        cos_h = jnp.maximum(1.0 - fall, 0.0)
        tan_h = jnp.sqrt((1.0 - cos_h) * (1.0 + cos_h)) / jnp.maximum(cos_h, 1e-30)
        return v_cavity_map(wi, u1, u2, self.width, tan_h / self.width, power_law)
