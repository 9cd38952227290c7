"""The model of Cook and Torrance, with the factor that it means and with the one that it has."""

import dataclasses
from typing import ClassVar

from gonio.models.brdf import Channels, Direction, Scalar, parameter
from gonio.models.fresnel import fresnel_of
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import half_angles
from gonio.models.microfacet import base as mf
from gonio.models.microfacet import distributions as slopes
from gonio.models.microfacet.v_cavity import v_cavity_map, v_cavity_visibility
from gonio.models.microfacet.widths import LAST_SLOPE, AbstractGaussianFacets
from gonio.models.warps.radial_laws import linear_law

ALPHA = dataclasses.replace(mf.ALPHA, high=3.0)  # published fits go to 2.1


class AbstractCookTorrance(AbstractGaussianFacets):
    """A constant that the final class gives, times F D G/(cosθi cosθo): Beckmann's D, the G of V-cavities."""

    lobe = True
    factor: ClassVar[float]

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        half = half_angles(wi, wo)
        density = slopes.beckmann_d(half.h, *self.widths)
        reflected = fresnel_of(self, positive(half.cos_d))
        return self.factor * reflected * density * v_cavity_visibility(wi, wo, half)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope, cut at the kinks of G."""
        return v_cavity_map(wi, u1, u2, self.mean_widths[0], LAST_SLOPE, linear_law)


class CookTorrance(AbstractCookTorrance):
    """f = F D G/(4 cosθi cosθo) with Beckmann's D and the G of V-cavities [Cook & Torrance 1982; 1/4 of Walter 2007].

    D is normalised, ∫ D cosθ dω = 1. `f0`, or `eta` (and `k`), or none (F = 1).
    """

    factor = 0.25

    alpha: Channels = parameter(ALPHA)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)


class CookTorrance1982(AbstractCookTorrance):
    """f = F D′ G/(π cosθi cosθo), D′ = πD of `cook_torrance`: as printed, four times too much [Cook & Torrance 1982].

    Published fits made with the printed formula (Ngan 2005, Löw 2012) need it. `f0`, or `eta` (and `k`), or none.
    """

    violates: ClassVar = {"energy": "It reflects four times what its facets receive: about 4 for F = 1, α = 0.3."}
    factor = 1.0

    alpha: Channels = parameter(ALPHA)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)
