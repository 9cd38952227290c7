"""A surface seen from the other side: light and detector of given sides, both mirrored into the front hemisphere."""

import equinox as eqx

from gonio.models.arrays import Channels
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction


class Folded(AbstractBRDF):
    """f of light and detector on given sides, 1 in front and −1 behind, by their mirror images in front.

    What integrates, averages or draws over one hemisphere serves the other one so: cosines are |z|, and what goes
    straight through stands in the mirror direction.
    """

    base: AbstractBRDF
    light: int = eqx.field(static=True)
    detector: int = eqx.field(static=True)

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic

    @property
    def accuracy(self) -> float:
        return self.base.accuracy

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.base.f(wi._replace(z=self.light * wi.z), wo._replace(z=self.detector * wo.z))


def seen_from(brdf: AbstractBRDF, light: int, detector: int) -> AbstractBRDF:
    """The surface with light and detector on these sides; itself where both are in front."""
    return brdf if (light, detector) == (1, 1) else Folded(brdf, light, detector)
