"""Apertures of light and detector as lists of directions with solid angles, and pairs of them as integrals of f.

The light is at azimuth 0: it leans towards +x, its mirror direction towards −x.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from gonio.models.geometry.directions import Direction

RATIO, LEVELS = 4.0, 6
"""Panels shrink so much from one to the next towards the mirror direction, so often: to 2e-4 of an aperture."""


class Beam(NamedTuple):
    """Directions with components (n,), and the solid angle (n,), sr, that each stands for."""

    directions: Direction
    solid_angle: np.ndarray

    @property
    def projected(self) -> np.ndarray:
        """Projected solid angles |cosθ| dω (n,), sr."""
        return self.solid_angle * np.abs(self.directions.z)


class Rule(NamedTuple):
    """Pairs of directions with components (n,) and weights (n,): an integral of f is Σ weight f."""

    wi: Direction
    wo: Direction
    weight: np.ndarray


def ray(theta: float, phi: float = 0.0) -> Beam:
    """One direction of polar angle and azimuth, radians, with the weight 1."""
    s = math.sin(theta)
    components = (s * math.cos(phi), s * math.sin(phi), math.cos(theta))
    return Beam(Direction(*(np.array([c]) for c in components)), np.ones(1))


def mirror(w: Direction) -> Direction:
    """Where a plane surface reflects the light of directions to."""
    return Direction(-w.x, -w.y, w.z)


def ring(axis: Direction, inner: float, outer: float, order: int, turns: int) -> Beam:
    """The directions between two angles, radians, about one direction in the plane of incidence.

    Of a disc, where the inner angle is 0, panels shrink towards its middle.
    """
    return turned_about(axis, graded(outer) if inner == 0 else np.geomspace(inner, outer, 3), order, turns)


def turned_about(axis: Direction, edges: np.ndarray, order: int, turns: int) -> Beam:
    """The directions all around an axis in the plane of incidence, by panels between angles from it, radians."""
    angle, weight = gauss(edges, order)
    phi = 2 * np.pi * (np.arange(turns) + 0.5) / turns
    a, p = (g.ravel() for g in np.meshgrid(angle, phi, indexing="ij"))
    along, across, ahead = np.sin(a) * np.cos(p), np.sin(a) * np.sin(p), np.cos(a)
    x, z = float(axis.x[0]), float(axis.z[0])
    turned = Direction(along * z + ahead * x, across, ahead * z - along * x)
    return Beam(turned, np.repeat(weight, turns) * np.sin(a) * 2 * np.pi / turns)


def band(low: float, high: float, order: int, turns: int) -> Beam:
    """The directions between two polar angles, radians, all around the normal, by one panel."""
    return turned_about(ray(0.0).directions, np.array([low, high]), order, turns)


def rectangle(axis: Direction, size: tuple[float, float], order: int, towards: Direction | None = None) -> Beam:
    """The directions through a rectangle in a plane at right angles to its axis, as the field stop of a lens.

    Args:
        axis: the direction to its middle, in the plane of incidence, components (1,).
        size: full angles, radians, within the plane of incidence and at right angles to it.
        order: nodes of a panel along each side.
        towards: a direction towards which panels shrink; None: one panel, for what is smooth.
    """
    x0, z0 = float(axis.x[0]), float(axis.z[0])
    half = [math.tan(s / 2) for s in size]
    place = (0.0, 0.0)
    if towards is not None:
        tx, ty, tz = (float(c) for c in towards)
        ahead = tx * x0 + tz * z0
        place = (tx * z0 - tz * x0) / ahead, ty / ahead
    sides = []
    for h, p in zip(half, place, strict=True):
        inside = min(max(p, -h), h)
        edges = np.array([-h, h])
        if towards is not None:
            edges = np.unique(np.concatenate([inside - graded(inside + h), inside + graded(h - inside)]))
        sides.append(gauss(edges, order))
    (u, du), (v, dv) = sides
    x, y = (g.ravel() for g in np.meshgrid(u, v, indexing="ij"))
    length = np.sqrt(1 + x**2 + y**2)
    directions = Direction((x0 + x * z0) / length, y / length, (z0 - x * x0) / length)
    return Beam(directions, np.outer(du, dv).ravel() / length**3)


def pairs(source: Beam, source_weight: np.ndarray, receptor: Beam, receptor_weight: np.ndarray) -> Rule:
    """All directions of light with all of detector, by the product of weights (m,) and (n,)."""
    m, n = source_weight.size, receptor_weight.size
    wi = Direction(*(np.repeat(c, n) for c in source.directions))
    wo = Direction(*(np.tile(c, m) for c in receptor.directions))
    return Rule(wi, wo, np.outer(source_weight, receptor_weight).ravel())


def joined(rules: list[Rule]) -> Rule:
    """The sum of several integrals as one."""
    wi, wo = (Direction(*(np.concatenate([r[k][c] for r in rules]) for c in range(3))) for k in (0, 1))
    return Rule(wi, wo, np.concatenate([r.weight for r in rules]))


def gauss(edges: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of Gauss–Legendre in panels between edges."""
    x, w = _gauss(order)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()


@functools.cache
def _gauss(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of Gauss–Legendre from −1 to 1."""
    return np.polynomial.legendre.leggauss(order)


def graded(length: float) -> np.ndarray:
    """Edges from 0 to a length, of panels that shrink towards 0; 0 alone where there is none."""
    if length <= 0:
        return np.zeros(1)
    return np.concatenate([[0.0], length * RATIO ** -np.arange(LEVELS, -1.0, -1.0)])
