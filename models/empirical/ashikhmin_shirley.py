"""The anisotropic gloss of Ashikhmin and Shirley."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.empirical.cosine_power import exponent_at, power_density, power_normal, power_widths
from gonio.models.fresnel import fresnel_of
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import half_angles, log_cosine, mirrored_pdf
from gonio.models.microfacet import base as mf
from gonio.models.microfacet.widths import along_axes
from gonio.models.warps.radial_laws import power_reach, power_slope
from gonio.models.warps.slopes import facet_direction, slope_ray

N = ParameterInfo(
    0.0, 1e6, "1", "exponent of the cosine between half vector and normal", start=60.0, role="exponent", log=True
)
N_X = ParameterInfo(
    0.0, 1e6, "1", "exponent where the half vector leans along x", start=100.0, role="exponent", log=True
)
N_Y = ParameterInfo(
    0.0, 1e6, "1", "exponent where the half vector leans along y", start=30.0, role="exponent", log=True
)


class AshikhminShirley(AbstractBRDF):
    """f = √((n_x+1)(n_y+1))/(8π) cosⁿθ_h F(d)/(d max(μi, μo)): anisotropic Phong [Ashikhmin & Shirley 2000, eq. 4].

    n = n_x cos²φ_h + n_y sin²φ_h, d = wi·h. `n`, or `n_x` with `n_y`; `f0`, or `eta` (and `k`), or none (F = 1). The
    gloss alone: `ashikhmin_shirley_diffuse` is the paper's diffuser below it.
    """

    lobe = True
    loses_energy = "A wide lobe loses near grazing: for n = 10 and F = 1 it reflects 0.50 there."

    n: Channels | None = parameter(N, default=None)
    n_x: Channels | None = parameter(N_X, default=None)
    n_y: Channels | None = parameter(N_Y, default=None)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)

    @property
    def exponents(self) -> tuple[Scalar, Scalar]:
        """(n_x, n_y); twice n where the surface is isotropic."""
        return along_axes(self, "n")

    @property
    def mean_exponents(self) -> tuple[Scalar, Scalar]:
        """The exponents by which directions are drawn: their mean where channels differ."""
        n_x, n_y = self.exponents
        return jnp.mean(n_x), jnp.mean(n_y)

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return power_widths(*self.mean_exponents)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h, cos_d, sin2_h = half_angles(wi, wo)
        cos_d, higher = positive(cos_d), positive(jnp.maximum(wi.z, wo.z))
        n_x, n_y = self.exponents
        power = jnp.exp(exponent_at(h, sin2_h, n_x, n_y) * log_cosine(h, sin2_h))
        scale = jnp.sqrt((n_x + 1.0) * (n_y + 1.0)) / (8 * jnp.pi)
        return scale * power * fresnel_of(self, cos_d) * (1.0 / cos_d) * (1.0 / higher)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        return reflect(wi, power_normal(*self.mean_exponents, u1, u2)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return mirrored_pdf(lambda m: power_density(m, *self.mean_exponents), wi, wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope, Gaussian in the radius, split at u2 = ½ where cosθo = cosθi.

        That is the slope at which a facet that leans towards the light (u1 in [¼, ¾]) has the slope lean/length².
        """
        n_x, n_y = (jnp.min(n) for n in self.exponents)  # the widest channel: the map must hold all of them
        widths = power_widths(n_x, n_y)
        ray = slope_ray(wi, u1, *widths)
        length2 = ray.slope_x**2 + ray.slope_y**2
        reach = power_reach(length2, ray.horizon)
        inner = jnp.where(ray.lean > 0, power_reach(length2, jnp.maximum(ray.lean, 0.0) / length2), 0.5 * reach)
        inner = jnp.minimum(inner, reach)
        first = u2 < 0.5
        radius = jnp.where(first, 2.0 * u2 * inner, inner + (2.0 * u2 - 1.0) * (reach - inner))
        s, rate = power_slope(length2, radius)
        return facet_direction(wi, ray, s, rate * 2.0 * jnp.where(first, inner, reach - inner), *widths)
