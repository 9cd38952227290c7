"""The sides of a sample between which a plan reads: directions mirrored into the front, and back to where they are."""

from typing import NamedTuple

import numpy as np

from gonio.data.highlights import facet_direction
from gonio.instrument.scans import HEMISPHERES
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction, from_spherical, to_spherical
from gonio.models.geometry.sides import Hemispheres, side_in_words

LIGHTS = {"front": (1,), "back": (-1,), "both": (1, -1)}


class Way(NamedTuple):
    """Light from one side of the sample to another, 1 in front and −1 behind."""

    light: int = 1
    detector: int = 1
    bend: float = 1.0
    """sin θo / sin θi of what an interface refracts; 1 for what is reflected, or goes straight through."""

    def unfolded(self, angles: np.ndarray) -> np.ndarray:
        """Directions (4, n), radians, whose polar angles were counted from the normals of their sides; and back."""
        theta_i, phi_i, theta_o, phi_o = angles
        polar = (a if side > 0 else np.pi - a for a, side in ((theta_i, self.light), (theta_o, self.detector)))
        theta_i, theta_o = polar
        return np.stack([theta_i, phi_i, theta_o, phi_o])

    @property
    def reciprocal(self) -> bool:
        """Whether the same light goes the way back: not through a sample, which the other side's light does."""
        return self.light == self.detector

    def reads(self, angles: np.ndarray) -> np.ndarray:
        """Which of the directions (4, n) are on its sides."""
        theta_i, _, theta_o, _ = angles
        return ((theta_i < np.pi / 2) == (self.light > 0)) & ((theta_o < np.pi / 2) == (self.detector > 0))

    def words(self) -> str:
        """What is read so."""
        return side_in_words(self.light, self.detector)

    def sent(self, light: np.ndarray, facet: Direction) -> np.ndarray:
        """(theta, phi) (2, n) from its side's normal where a facet sends the light (2, n); NaN where it sends none."""
        wi = from_spherical(light[0], light[1], np)
        return np.stack([np.asarray(a) for a in to_spherical(facet_direction(wi, facet, self.bend))])


def ways_of(brdf: AbstractBRDF, lit: str = "front", hemisphere: str = "both") -> tuple[Way, ...]:
    """Where a surface sends light from these sides ("front", "back" or "both"), into these hemispheres.

    `hemisphere`: "reflection", "transmission" or "both". Raises GonioError for other words, and where it sends none.
    """
    if lit not in LIGHTS:
        raise GonioError(f"lit is {lit!r}; give front, back or both")
    if hemisphere not in HEMISPHERES:
        raise GonioError(f"hemisphere is {hemisphere!r}; give {', '.join(HEMISPHERES[:-1])} or {HEMISPHERES[-1]}")
    index = float(np.mean(np.asarray(brdf.index_behind)))
    back = {1: Hemispheres.REFLECTION, -1: Hemispheres.BACK}
    ways: list[Way] = []
    for light in LIGHTS[lit]:
        if back[light] in brdf.hemispheres and hemisphere != "transmission":
            ways.append(Way(light, light))
        if Hemispheres.TRANSMISSION in brdf.hemispheres and hemisphere != "reflection":
            ways.append(Way(light, -light, 1 / index if light > 0 else index))
    if not ways:
        into = "" if hemisphere == "both" else f" in {hemisphere}"
        where = "behind" if lit == "back" else "there"
        raise GonioError(f"the surface sends no light on{into} that comes from {where}")
    return tuple(ways)
