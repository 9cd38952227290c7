"""The sides of a sample, in front and behind, and the one threshold of what lies on the horizon; without JAX."""

import enum
import functools
import operator
from typing import Any

import numpy as np

HORIZON = 4.440892098500626e-16
"""Cosine up to which a direction lies on the horizon: two roundings of 1, as π/2 in double precision has the cosine
6e-17 and the cosines of a grid, products of two, end within 3e-16 of 0."""
BEHIND = -1e-6
"""Cosine of a stated direction from which on it lies behind the sample: of a right angle in single precision it is
−4e-8, and such a direction lies on the horizon."""

Sides = frozenset[tuple[int, int]]
"""Sides of (light, detector), 1 in front and −1 behind."""
FRONT: Sides = frozenset({(1, 1)})


class Hemispheres(enum.Flag):
    """What a surface scatters: light in front back to it, light of either side through it, light from behind back.

    +z is the front; a direction with z < 0 is behind the surface.
    """

    REFLECTION = enum.auto()
    TRANSMISSION = enum.auto()
    BACK = enum.auto()


TWO_SIDED = Hemispheres.REFLECTION | Hemispheres.BACK
EVERYWHERE = TWO_SIDED | Hemispheres.TRANSMISSION


def side(cosine: Any) -> np.ndarray:
    """1 where a stated direction is in front of the sample, −1 behind, 0 on the horizon (NumPy, any shape)."""
    cosine = np.asarray(cosine)
    return (cosine > HORIZON).astype(np.int8) - (cosine < BEHIND)


def hemispheres_of(sides: Sides) -> Hemispheres:
    """What a surface does with light that goes from one to the other of these sides."""
    back = {1: Hemispheres.REFLECTION, -1: Hemispheres.BACK}
    ways = (back[light] if light == detector else Hemispheres.TRANSMISSION for light, detector in sides)
    return functools.reduce(operator.or_, ways, Hemispheres(0))


def side_in_words(light: int, detector: int) -> str:
    """What a detector on its side reads of a light on its own, in words."""
    kind = "reflection" if light == detector else "transmission"
    return kind if light > 0 else f"{kind}, lit from behind"


def sides_in_words(sides: Sides) -> str:
    """The sides that a table holds, in words; nothing for reflection from the front alone."""
    if sides == FRONT:
        return ""
    words = []
    for light, suffix in ((1, ""), (-1, ", lit from behind")):
        kinds = [side_in_words(1, light * detector) for a, detector in sides if a == light]
        words += [" and ".join(sorted(kinds)) + suffix] if kinds else []
    return "; ".join(words)
