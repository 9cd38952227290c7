"""Reflection by microfacets, F·D·G/(4 cosθi cosθo) [Cook & Torrance 1982, with the 1/4 of Walter 2007, eq. 20]."""

import abc

from gonio.models.brdf import Channels, Direction, ParameterInfo, Scalar
from gonio.models.fresnel import fresnel_of
from gonio.models.geometry.half_vector import half_angles
from gonio.models.microfacet.widths import AbstractFacets

ALPHA = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution", start=0.3, role="width", log=True)
ALPHA_X = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution along x", start=0.2, role="width", log=True)
ALPHA_Y = ParameterInfo(1e-4, 1.0, "1", "width of the slope distribution along y", start=0.4, role="width", log=True)
F0 = ParameterInfo(0.0, 1.0, "1", "Fresnel reflectance at normal incidence (Schlick)", start=0.04, role="fresnel")
ETA = ParameterInfo(
    0.01, 20.0, "1", "refractive index, relative to the outside (exact Fresnel)", start=1.5, role="index", log=True
)
K = ParameterInfo(0.0, 50.0, "1", "extinction coefficient (exact Fresnel, with eta)", start=3.0, role="extinction")


class AbstractMicrofacet(AbstractFacets):
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

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h, cos_d, _ = half_angles(wi, wo)
        return fresnel_of(self, cos_d) * (self.density(h) * self.visibility(wi, wo))
