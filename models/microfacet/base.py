"""Reflection by microfacets, F·D·G/(4 cosθi cosθo) [Cook & Torrance 1982, with the 1/4 of Walter 2007, eq. 20]."""

import abc

from gonio.models.brdf import Channels, Direction, ParameterInfo, Scalar
from gonio.models.fresnel import fresnel_of
from gonio.models.geometry.half_vector import half_angles
from gonio.models.microfacet.widths import AbstractWidths
from gonio.models.warps.slopes import facet_direction, slope_ray

ALPHA = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution", start=0.3, role="width", log=True)
ALPHA_X = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution along x", start=0.2, role="width", log=True)
ALPHA_Y = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution along y", start=0.4, role="width", log=True)
F0 = ParameterInfo(0.0, 1.0, "1", "Fresnel reflectance at normal incidence (Schlick)", start=0.04, role="fresnel")
ETA = ParameterInfo(
    0.01, 20.0, "1", "refractive index, relative to the outside (exact Fresnel)", start=1.5, role="index", log=True
)
K = ParameterInfo(0.0, 50.0, "1", "extinction coefficient (exact Fresnel, with eta)", start=3.0, role="extinction")


class AbstractMicrofacet(AbstractWidths):
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

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h, cos_d, _ = half_angles(wi, wo)
        return fresnel_of(self, cos_d) * (self.density(h) * self.visibility(wi, wo))

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope, out to the horizon's (see `gonio.models.warps.slopes`)."""
        widths = self.mean_widths
        ray = slope_ray(wi, u1, *widths)
        s, radial_rate = self.slope_radius(u2, ray.horizon)
        return facet_direction(wi, ray, s, radial_rate, *widths)
