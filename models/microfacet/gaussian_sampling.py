"""What lobes of facets with Gaussian slopes share where they are not `Beckmann`'s: how directions are drawn."""

import abc

from gonio.models.brdf import AbstractBRDF, Direction, Scalar
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.half_vector import mirrored_pdf
from gonio.models.microfacet import distributions as slopes

LAST_SLOPE = 6.5  # exp(-6.5²) = 4e-19: beyond it lies nothing that a double could add


class AbstractGaussianFacets(AbstractBRDF):
    """A lobe that is drawn by mirroring wi in a facet with Gaussian slopes [Ward 1992]."""

    @property
    @abc.abstractmethod
    def mean_widths(self) -> tuple[Scalar, Scalar]:
        """The widths along x and y by which directions are drawn: their mean where channels differ."""

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return self.mean_widths

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Direction:
        return reflect(wi, slopes.beckmann_normal(*self.mean_widths, u1, u2))

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return mirrored_pdf(lambda m: slopes.beckmann_d(m, *self.mean_widths) * m.z, wi, wo)
