"""A surface seen from the other side: light and detector of given sides, both mirrored into the front hemisphere."""

import equinox as eqx

from gonio.models.arrays import Channels, Scalar
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.sides import Hemispheres


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

    @property
    def costly(self) -> bool:
        return self.base.costly

    @property
    def kinked(self) -> bool:
        return self.base.kinked

    @property
    def totally_reflects(self) -> bool:
        return self.base.totally_reflects

    def terms(self) -> tuple[AbstractBRDF, ...]:
        """Those of the base that send light from that side to this one, each seen so; none where it is dark."""
        way = Hemispheres.REFLECTION if self.light == self.detector else Hemispheres.TRANSMISSION
        if way == Hemispheres.REFLECTION and self.light < 0:
            way = Hemispheres.BACK
        return tuple(Folded(t, self.light, self.detector) for t in self.base.terms() if way in t.hemispheres)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """That of the base over both hemispheres, of which f is 0 in the one that is not looked at."""
        wo, jacobian = self.base.lobe_map(wi._replace(z=self.light * wi.z), u1, u2)
        return wo._replace(z=self.detector * wo.z), jacobian

    def flux(self, wi: Direction, u1: Scalar, u2: Scalar, side: Scalar) -> Channels:
        return self.base.flux(wi._replace(z=self.light * wi.z), u1, u2, side * self.detector)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.base.f(wi._replace(z=self.light * wi.z), wo._replace(z=self.detector * wo.z))


def seen_from(brdf: AbstractBRDF, light: int, detector: int) -> AbstractBRDF:
    """The surface with light and detector on these sides; itself where both are in front."""
    return brdf if (light, detector) == (1, 1) else Folded(brdf, light, detector)
