"""Reflection by microfacets, F·D·G/(4 cosθi cosθo) [Cook & Torrance 1982, with the 1/4 of Walter 2007, eq. 20]."""

import abc

import jax.numpy as jnp

from gonio.models.azimuth_map import grazing_azimuth, grazing_tangent, polar_parts
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

    @abc.abstractmethod
    def density(self, m: Direction) -> Scalar:
        """Density of the facet normals, 1/sr."""

    @abc.abstractmethod
    def visibility(self, wi: Direction, wo: Direction) -> Scalar:
        """G₂(wi, wo)/(4 cosθi cosθo), finite at grazing."""

    @abc.abstractmethod
    def slope_radius(self, u2: Scalar, width: Scalar, horizon: Scalar) -> tuple[Scalar, Scalar]:
        """A slope in [0, horizon] from u2 in [0, 1] by the distribution's own scale, and its derivative by u2."""

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
        """Polar coordinates of the facet's slope, out to the slope that reflects to the horizon.

        In the azimuth ψ from the plane of incidence the facets of slope r reflect above the horizon when
        r < tanθi cosψ + √(tan²θi cos²ψ + 1): the range is explicit, and the integrand analytic inside it.
        """
        alpha_x, alpha_y = self.mean_widths
        _, cos_a, sin_a = polar_parts(wi)
        tan_i = grazing_tangent(wi)
        cos_p, sin_p, azimuth_rate = grazing_azimuth(tan_i, u1)
        e_x, e_y = cos_a * cos_p - sin_a * sin_p, sin_a * cos_p + cos_a * sin_p
        lean = tan_i * cos_p
        root = jnp.sqrt(lean * lean + 1.0)
        horizon = jnp.where(lean >= 0, lean + root, 1.0 / (root + jnp.abs(lean)))
        width = 1.0 / jnp.sqrt((e_x / alpha_x) ** 2 + (e_y / alpha_y) ** 2)
        r, radial_rate = self.slope_radius(u2, width, horizon)
        m_z = 1.0 / jnp.sqrt(1.0 + r * r)
        m = Direction(r * e_x * m_z, r * e_y * m_z, m_z)
        facing = dot(wi, m)
        return reflect(wi, m), 4.0 * facing * m_z**3 * r * radial_rate * azimuth_rate
