"""Reflection by microfacets, F·D·G/(4 cosθi cosθo) [Cook & Torrance 1982, with the 1/4 of Walter 2007, eq. 20]."""

import abc

import jax.numpy as jnp

from gonio.models.azimuth_map import TANGENT_MAX, grazing_azimuth, polar_parts
from gonio.models.base import AbstractBRDF, Scalar
from gonio.models.fresnel import fresnel
from gonio.models.geometry import Direction, dot, half_vector, reflect
from gonio.models.parameters import ParameterInfo

ALPHA = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution", start=0.3, log=True)
ALPHA_X = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution along x", start=0.2, log=True)
ALPHA_Y = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution along y", start=0.4, log=True)
F0 = ParameterInfo(0.0, 1.0, "1", "Fresnel reflectance at normal incidence (Schlick)", start=0.04)
ETA = ParameterInfo(0.01, 20.0, "1", "refractive index, relative to the outside (exact Fresnel)", start=1.5, log=True)
K = ParameterInfo(0.0, 50.0, "1", "extinction coefficient (exact Fresnel, with eta)", start=3.0)


class AbstractMicrofacet(AbstractBRDF):
    """The microfacet formula over a slope distribution that the final class names.

    A final class has the fields `alpha` or `alpha_x` and `alpha_y`; `f0` or `eta` (and `k`) or none of them, which
    means F = 1; and `smith`, how the two maskings combine.
    """

    lobe = True

    @abc.abstractmethod
    def density(self, m: Direction) -> Scalar:
        """Density of the facet normals, 1/sr."""

    @abc.abstractmethod
    def visibility(self, wi: Direction, wo: Direction) -> Scalar:
        """G₂(wi, wo)/(4 cosθi cosθo), finite at grazing."""

    @abc.abstractmethod
    def slope_radius(self, u2: Scalar, horizon: Scalar) -> tuple[Scalar, Scalar]:
        """A slope, in units of the width, in [0, horizon] from u2 in [0, 1], and its derivative by u2."""

    @property
    def widths(self) -> tuple[Scalar, Scalar]:
        """(alpha_x, alpha_y); twice alpha where the surface is isotropic."""
        return (self.alpha, self.alpha) if self.alpha_x is None else (self.alpha_x, self.alpha_y)

    @property
    def mean_widths(self) -> tuple[Scalar, Scalar]:
        """The widths by which directions are drawn: their mean where channels differ, as geometry has no channels."""
        return tuple(jnp.mean(w) for w in self.widths)

    def f(self, wi, wo):
        above = (wi.z > 0) & (wo.z > 0)
        up = Direction(jnp.zeros_like(wi.x), jnp.zeros_like(wi.x), jnp.ones_like(wi.x))
        # Below the horizon the formula is evaluated at the normal instead, so that no gradient there is NaN.
        wi, wo = (Direction(*(jnp.where(above, c, e) for c, e in zip(w, up, strict=True))) for w in (wi, wo))
        h = half_vector(wi, wo)
        cos_d = jnp.clip(dot(wi, h), 0.0, 1.0)
        value = fresnel(cos_d, self.f0, self.eta, self.k) * self.density(h) * self.visibility(wi, wo)
        return jnp.where(above, value, 0.0)

    def lobe_map(self, wi, u1, u2):
        """Polar coordinates (s, ψ) of the facet's slope in units of the widths, out to the horizon's slope.

        With the slope (α_x s cosψ, α_y s sinψ), its length ρs, and t = (α_x wi.x cosψ + α_y wi.y sinψ)/wi.z, a facet
        reflects above the horizon when ρ²s² − 2ts − 1 < 0, so for s < (t + √(t² + ρ²))/ρ²: the range is explicit, and
        the integrand analytic inside it.
        """
        alpha_x, alpha_y = self.mean_widths
        cos_i = jnp.maximum(wi.z, 1.0 / TANGENT_MAX)
        lean_most, cos_a, sin_a = polar_parts(Direction(alpha_x * wi.x / cos_i, alpha_y * wi.y / cos_i, wi.z))
        across = jnp.sqrt((alpha_x * sin_a) ** 2 + (alpha_y * cos_a) ** 2)
        cos_p, sin_p, azimuth_rate = grazing_azimuth(lean_most / across, u1)
        slope_x = alpha_x * (cos_a * cos_p - sin_a * sin_p)
        slope_y = alpha_y * (sin_a * cos_p + cos_a * sin_p)
        length2 = slope_x**2 + slope_y**2
        lean = lean_most * cos_p
        root = jnp.sqrt(lean * lean + length2)
        horizon = jnp.where(lean >= 0, (lean + root) / length2, 1.0 / (root + jnp.abs(lean)))
        s, radial_rate = self.slope_radius(u2, horizon)
        m_z = 1.0 / jnp.sqrt(1.0 + s * s * length2)
        m = Direction(s * slope_x * m_z, s * slope_y * m_z, m_z)
        facing = dot(wi, m)
        return reflect(wi, m), 4.0 * facing * m_z**3 * alpha_x * alpha_y * s * radial_rate * azimuth_rate
