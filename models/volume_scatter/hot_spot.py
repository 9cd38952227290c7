"""Surfaces with a peak in retroreflection."""

import abc

from gonio.models.brdf import AbstractBRDF, Direction, Scalar
from gonio.models.warps.retroreflection import hot_spot_map


class AbstractHotSpot(AbstractBRDF):
    """A surface with a peak in retroreflection, at the scales that the final class gives."""

    @abc.abstractmethod
    def hot_spot(self, wi: Direction) -> tuple[Scalar, Scalar]:
        """The scales of `hot_spot_map`, radians: of the peak, and of what changes before the horizon."""

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return hot_spot_map(wi, u1, u2, *self.hot_spot(wi))
