"""Angles of pairs of directions, and an order of pairs in which neighbours follow each other."""

import functools
from typing import NamedTuple

import numpy as np

from gonio.models.geometry.directions import Direction

BITS = 15  # of each of four coordinates in the order along the curve


class PairAngles(NamedTuple):
    """Angles of pairs of directions, degrees, (n,) each: polar angles, half angle and difference angle.

    Half and difference angles of what goes through are those of its mirror image in front.
    """

    theta_i: np.ndarray
    theta_o: np.ndarray
    theta_h: np.ndarray
    theta_d: np.ndarray

    @property
    def phase(self) -> np.ndarray:
        """Angle between the two directions, degrees."""
        return 2.0 * self.theta_d


def pair_angles(wi: Direction, wo: Direction) -> PairAngles:
    """The angles of pairs of unit directions with components (n,)."""
    i, o = (np.stack([np.asarray(c, float) for c in w]) for w in (wi, wo))
    polar = [np.arctan2(np.hypot(w[0], w[1]), w[2]) for w in (i, o)]
    i, o = (np.stack([w[0], w[1], np.abs(w[2])]) for w in (i, o))
    polar.append(np.arctan2(np.hypot(*(i + o)[:2]), (i + o)[2]))
    theta_d = np.arctan2(np.linalg.norm(i - o, axis=0), np.linalg.norm(i + o, axis=0))
    return PairAngles(*(np.degrees(a) for a in (*polar, theta_d)))


def neighbour_order(wi: Direction, wo: Direction, by_incidence: bool = False) -> np.ndarray:
    """A permutation (n,) that goes through pairs of directions by short steps: the Z-order curve of Morton [1966].

    The curve runs through the four tangent-plane components of both directions; or, `by_incidence`, one runs through
    the incident directions and at each of them another through the outgoing ones.
    """
    code = np.zeros(np.asarray(wi.x).size, np.uint64)
    for k, c in enumerate((wi.x, wi.y, wo.x, wo.y)):
        level = np.clip((np.asarray(c, float) + 1.0) * (1 << (BITS - 1)), 0, (1 << BITS) - 1).astype(np.intp)
        position = k % 2 + (2 * BITS if k < 2 else 0) if by_incidence else k
        code |= _spreads(2 if by_incidence else 4).take(level) << np.uint64(position)
    behind_i, behind_o = (np.asarray(w.z) < 0 for w in (wi, wo))
    if not (behind_i.any() or behind_o.any()):
        return np.argsort(code, kind="stable")
    return np.lexsort((code, 2 * behind_i + behind_o))


@functools.cache
def _spreads(step: int) -> np.ndarray:
    """Of each number of so many `BITS`."""
    return _spread(np.arange(1 << BITS, dtype=np.uint64), step)


def _spread(level: np.ndarray, step: int) -> np.ndarray:
    """Numbers of 16 bits whose bits stand so many places apart: 2 or 4 [Warren 2013, ch. 7]."""
    for half in (8, 4, 2, 1):
        # Of each piece of 2·half bits the upper half moves on.
        mask = sum(((1 << half) - 1) << (step * half * k) for k in range(16 // half))
        level = (level | (level << np.uint64(half * (step - 1)))) & np.uint64(mask)
    return level
