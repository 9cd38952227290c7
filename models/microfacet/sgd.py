"""The shifted gamma distribution of Bagher, Soler and Holzschuch."""

from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import half_angles, mirrored_pdf
from gonio.models.microfacet.distributions import ggx_d, ggx_normal
from gonio.models.warps.grazing_azimuth import polar_parts
from gonio.models.warps.radial_laws import power_law
from gonio.models.warps.slopes import facet_direction, slope_ray

ALPHA = ParameterInfo(1e-5, 10.0, "1", "shift and width of the gamma law", start=0.1, role="width", log=True)
P = ParameterInfo(0.0, 5.0, "1", "exponent of the core", start=0.7, role="exponent")
KAPPA = ParameterInfo(0.0, 1e6, "1", "factor of the distribution", start=5.0, role="scale", linear=True)
F_0 = ParameterInfo(
    0.0, 20.0, "1", "reflectance at normal incidence, before f1 is taken off", start=0.04, role="fresnel"
)
F_1 = ParameterInfo(-5.0, 20.0, "1", "slope of the reflectance in cosθ_d", start=0.0, role="fresnel")
LAM = ParameterInfo(0.0, 1e8, "1", "depth of masking", start=3.0, role="masking")
C = ParameterInfo(1e-12, 1e120, "1", "rate of masking beyond theta_0", start=1e-4, role="masking", log=True)
K = ParameterInfo(0.1, 1000.0, "1", "exponent of masking beyond theta_0", start=15.0, role="masking", log=True)
THETA_0 = ParameterInfo(
    -1.0, 1.5707963267948966, "rad", "polar angle at which masking begins", start=0.0, role="masking"
)


class SGD(AbstractBRDF):
    """f = F D G₁(i) G₁(o)/(π cosθi cosθo) with the shifted gamma distribution [Bagher, Soler & Holzschuch 2012].

    D = kappa e^(−t)/(π cos⁴θ_h t^p), t = alpha + tan²θ_h/alpha; F = f0 + (1−f0)(1−d)⁵ − f1 d with d = cosθ_d;
    G₁ = 1 + lam(1 − exp(c(θ − theta_0)^k)) for θ > theta_0, and 1 below. All parameters may carry channels. Published
    numbers have c up to 1e109, which single precision does not hold. G₁ grows as the exponential of a power: beyond the
    largest number, where published fits (up to e¹⁷) never are, f is infinite or not a number.
    """

    lobe = True
    violates: ClassVar = {
        "energy": "kappa, f0 and G₁ are free numbers of a fit: nothing keeps what is reflected below 1.",
        "positivity": "F is negative where f1 exceeds f0 (at normal incidence), and G₁ beyond its zero near grazing.",
    }

    alpha: Channels = parameter(ALPHA)
    p: Channels = parameter(P)
    kappa: Channels = parameter(KAPPA)
    f0: Channels = parameter(F_0)
    f1: Channels = parameter(F_1)
    lam: Channels = parameter(LAM)
    c: Channels = parameter(C)
    k: Channels = parameter(K)
    theta_0: Channels = parameter(THETA_0)

    def density(self, h: Direction, sin2_h: Scalar) -> Channels:
        """D, 1/sr; 0 where e^(−t) is 0."""
        alpha = self.alpha
        z2 = h.z**2
        live = sin2_h < 740.0 * alpha * z2
        cos2 = jnp.where(live, z2, 1.0)
        t = alpha + jnp.where(live, sin2_h, 0.0) / (cos2 * alpha)
        return jnp.where(live, self.kappa * jnp.exp(-t - self.p * jnp.log(t)) / (jnp.pi * cos2 * cos2), 0.0)

    def masking(self, w: Direction) -> Channels:
        """G₁ of a direction above the horizon."""
        beyond = jnp.arctan2(polar_parts(w)[0], w.z) - self.theta_0
        masked = beyond > 0
        rise = jnp.log(self.c) + self.k * jnp.log(jnp.where(masked, beyond, 1.0))
        fall = -jnp.expm1(jnp.exp(jnp.where(masked, rise, 0.0)))
        return jnp.where(masked, 1.0 + self.lam * fall, 1.0)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h, cos_d, sin2_h = half_angles(wi, wo)
        m = 0.25 * sum((i - o) ** 2 for i, o in zip(wi, wo, strict=True)) / (1.0 + cos_d)  # 1 − cosθ_d to all digits
        reflected = self.f0 + (1.0 - self.f0) * (m * m) ** 2 * m - self.f1 * cos_d
        value = reflected * self.density(h, sin2_h) * (self.masking(wi) / positive(wi.z))
        return value * (self.masking(wo) / positive(wo.z)) / jnp.pi

    @property
    def core(self) -> tuple[Scalar, Scalar]:
        """(the slope at which D begins to fall, the slope beyond which it is 0), of the mean over channels."""
        alpha = jnp.mean(self.alpha)
        return jnp.minimum(alpha, jnp.sqrt(alpha)), jnp.sqrt(40.0 * jnp.max(self.alpha))

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """wi mirrored in a facet of GGX slopes as wide as the core."""
        return reflect(wi, ggx_normal(self.core[0], u1, u2)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return mirrored_pdf(lambda m: ggx_d(m, self.core[0], self.core[0]) * m.z, wi, wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope: equal steps of the inverse hyperbolic sine, out to where D is 0."""
        width, last = self.core
        ray = slope_ray(wi, u1, width, width)
        s, rate = power_law(u2, jnp.zeros_like(u2), jnp.minimum(ray.horizon, last / width))
        return facet_direction(wi, ray, s, rate, width, width)
