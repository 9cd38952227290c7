"""The sides of a sample between which a plan reads: directions mirrored into the front, and back to where they are."""

from typing import NamedTuple

import numpy as np

from gonio.data.highlights import facet_direction
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction, from_spherical, to_spherical
from gonio.models.geometry.sides import Hemispheres

LIGHTS = {"front": (1,), "back": (-1,), "both": (1, -1)}


class Way(NamedTuple):
    """Light from one side of the sample to another, 1 in front and −1 behind."""

    light: int = 1
    detector: int = 1
    bend: float = 1.0
    """sin θo / sin θi of what an interface refracts; 1 for what is reflected, or goes straight through."""

    def unfolded(self, angles: np.ndarray) -> np.ndarray:
        """Directions (4, n), radians, whose polar angles were counted from the normals of their sides."""
        theta_i, phi_i, theta_o, phi_o = angles
        polar = (a if side > 0 else np.pi - a for a, side in ((theta_i, self.light), (theta_o, self.detector)))
        theta_i, theta_o = polar
        return np.stack([theta_i, phi_i, theta_o, phi_o])

    def sent(self, light: np.ndarray, facet: Direction) -> np.ndarray:
        """(theta, phi) (2, n) from its side's normal where a facet sends the light (2, n); NaN where it sends none."""
        wi = from_spherical(light[0], light[1], np)
        return np.stack([np.asarray(a) for a in to_spherical(facet_direction(wi, facet, self.bend))])


def ways_of(brdf: AbstractBRDF, lit: str = "front") -> tuple[Way, ...]:
    """Where a surface sends light from these sides ("front", "back" or "both"); GonioError where it sends none."""
    if lit not in LIGHTS:
        raise GonioError(f"lit is {lit!r}; give front, back or both")
    index = float(np.mean(np.asarray(brdf.index_behind)))
    back = {1: Hemispheres.REFLECTION, -1: Hemispheres.BACK}
    ways: list[Way] = []
    for light in LIGHTS[lit]:
        if back[light] in brdf.hemispheres:
            ways.append(Way(light, light))
        if Hemispheres.TRANSMISSION in brdf.hemispheres:
            ways.append(Way(light, -light, 1 / index if light > 0 else index))
    if not ways:
        raise GonioError(f"the surface sends no light on that comes from {'behind' if lit == 'back' else 'there'}")
    return tuple(ways)
