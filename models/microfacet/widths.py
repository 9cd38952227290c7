"""Lobes of facets by the widths of their slopes, which may differ along x and y."""

import abc

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, Sample, Scalar
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.half_vector import mirrored_pdf
from gonio.models.microfacet.distributions import beckmann_d, beckmann_normal
from gonio.models.warps.slopes import facet_direction, slope_ray

LAST_SLOPE = 6.5  # exp(-6.5²) = 4e-19: beyond it lies nothing that a double could add


def along_axes(brdf: AbstractBRDF, name: str) -> tuple[Channels, Channels]:
    """The values of a parameter along x and y, such as alpha_x and alpha_y; twice alpha if isotropic."""
    x, y = getattr(brdf, f"{name}_x", None), getattr(brdf, f"{name}_y", None)
    return (getattr(brdf, name),) * 2 if x is None or y is None else (x, y)


class AbstractFacets(AbstractBRDF):
    """A lobe of facets whose final class has the field `alpha`, or `alpha_x` and `alpha_y` beside it."""

    @property
    def widths(self) -> tuple[Scalar, Scalar]:
        """(alpha_x, alpha_y); twice alpha where the surface is isotropic."""
        return along_axes(self, "alpha")

    @property
    def mean_widths(self) -> tuple[Scalar, Scalar]:
        """The widths by which directions are drawn: their mean where channels differ, as geometry has no channels."""
        alpha_x, alpha_y = self.widths
        return jnp.mean(alpha_x), jnp.mean(alpha_y)

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return self.mean_widths

    @abc.abstractmethod
    def slope_radius(self, u2: Scalar, horizon: Scalar) -> tuple[Scalar, Scalar]:
        """A slope, in units of the width, in [0, horizon] from u2 in [0, 1], and its derivative by u2."""

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope, out to the horizon's (see `gonio.models.warps.slopes`)."""
        widths = self.mean_widths
        ray = slope_ray(wi, u1, *widths)
        s, radial_rate = self.slope_radius(u2, ray.horizon)
        return facet_direction(wi, ray, s, radial_rate, *widths)


class AbstractGaussianFacets(AbstractFacets):
    """A lobe that is drawn by mirroring wi in a facet with Gaussian slopes [Ward 1992]."""

    def slope_radius(self, u2: Scalar, horizon: Scalar) -> tuple[Scalar, Scalar]:
        last = jnp.minimum(horizon, LAST_SLOPE)
        return last * u2, last

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        return reflect(wi, beckmann_normal(*self.mean_widths, u1, u2)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return mirrored_pdf(lambda m: beckmann_d(m, *self.mean_widths) * m.z, wi, wo)
