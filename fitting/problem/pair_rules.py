"""Nodes of averages over two discs at once, far fewer than every node of one with every node of the other.

A pair of directions is two points a, b of unit discs, x towards the other direction within the plane of both, y across:
the half vector then depends on u = rᵢ a + rₒ b alone, to first order, and with it what is narrow in a lobe. There are

- `layered`: tori |a|, |b| = const with the points of a lattice that is exact for trigonometric polynomials of a degree
  [Noskov 1988]; |a|², |b|² are even in [0, 1]. Exact for polynomials of a and b to degree 3, 5 or 7;
- `of_sums`: rings of u, whose density is that two discs overlap, exact for polynomials of u to degree 2n − 1; and for
  each u a few a in the lens that both discs leave, with its mean and covariance. Exact for a and b to degree 3.
"""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

LAYERED = {3: 8, 5: 30, 7: 81}
"""Number of pairs of each layered rule, by its degree."""
SUMS = ((8, 7), (12, 7), (18, 7), (26, 7), (38, 7), (56, 7), (80, 7))
"""n, and points a for each u, of rules of sums."""
COUNTS = (*LAYERED.values(), *(n * n * points for n, points in SUMS))
"""Pairs of all rules, from coarse to fine."""
FINENESS = (*((degree + 1) // 2 for degree in LAYERED), *(n for n, _ in SUMS))
"""n of all rules: they are exact for polynomials of u to degree 2n − 1."""
SEGMENT = 200
"""Nodes of the rules from which those of rings are made."""

PairNodes = Float[np.ndarray, "5 k"]
"""(x, y) of a, (x, y) of b, weights, whose sum is 1."""


class _Lens(NamedTuple):
    """Of a, uniform where both discs allow it, given |u|: mean along u, variances along and across u."""

    mean: np.ndarray
    along: np.ndarray
    across: np.ndarray


def pair_rules(radii: tuple[float, float]) -> list[PairNodes]:
    """The rules of all steps, for discs of these radii."""
    largest = max(radii)
    return _pair_rules((radii[0] / largest, radii[1] / largest))


@functools.lru_cache(maxsize=16)
def _pair_rules(radii: tuple[float, float]) -> list[PairNodes]:
    return [*map(layered, LAYERED), *(of_sums(radii, n, points) for n, points in SUMS)]


def layered(degree: int) -> PairNodes:
    """The rule of degree 3, 5 or 7."""
    nodes = []
    for r2_a, r2_b, weight in _layers(degree):
        if r2_a and r2_b:
            count = (degree + 1) ** 2 // 2
            alpha = 2 * np.pi * np.arange(count) / count
            beta = degree * alpha
        else:
            count = degree + 1 if r2_a or r2_b else 1
            alpha = beta = 2 * np.pi * np.arange(count) / count
        a, b = np.sqrt(r2_a), np.sqrt(r2_b)
        share = np.full(count, weight / count)
        nodes.append([a * np.cos(alpha), a * np.sin(alpha), b * np.cos(beta), b * np.sin(beta), share])
    return np.concatenate(nodes, axis=1)


def _layers(degree: int) -> list[tuple[float, float, float]]:
    """(|a|², |b|², weight): exact for polynomials of both to half the degree, few of them with both above 0."""
    if degree == 3:
        return [(1 / 2, 1 / 2, 1.0)]
    if degree == 5:
        return [(7 / 10, 7 / 10, 25 / 49), (7 / 12, 0.0, 12 / 49), (0.0, 7 / 12, 12 / 49)]
    low, high = 2 / 3 - np.sqrt(2 / 45), 2 / 3 + np.sqrt(2 / 45)
    both = [(low, high, 5 / 16), (high, low, 5 / 16)]
    return [*both, (1 / 3, 0.0, 1 / 4), (0.0, 1 / 3, 1 / 4), (0.0, 0.0, -1 / 8)]


def of_sums(radii: tuple[float, float], n: int, points: int) -> PairNodes:
    """n/2 rings of 2n sums u each, n even, and for each of them 4 or 7 points a."""
    r, of_ring = _rings(radii, n)
    lens = _lens(radii, r)
    # With few rings the lens's moments, no polynomials, are not summed exactly: scaled, they are.
    second = radii[0] ** 2 / 2
    mean = lens.mean * second / np.sum(of_ring * r * lens.mean)
    scale = np.sqrt((second - np.sum(of_ring * mean**2)) / np.sum(of_ring * (lens.along + lens.across)))
    x, y, w = _standard_points(points)
    along = mean[:, None] + scale * np.sqrt(lens.along)[:, None] * x
    across = scale * np.sqrt(lens.across)[:, None] * y
    # Every other ring is turned by half a step.
    turn = np.pi / n * (np.arange(2 * n) + 0.5 * (np.arange(r.size)[:, None] % 2))
    cos, sin = np.cos(turn)[..., None], np.sin(turn)[..., None]
    along, across = along[:, None, :], across[:, None, :]
    a = np.stack([cos * along - sin * across, sin * along + cos * across])
    b = np.stack(np.broadcast_arrays(cos * r[:, None, None], sin * r[:, None, None])) - a
    weight = np.broadcast_to(of_ring[:, None, None] / (2 * n) * w, a.shape[1:])
    return np.concatenate([a / radii[0], b / radii[1], weight[None]]).reshape(5, -1)


def _standard_points(count: int) -> np.ndarray:
    """(x, y, weight) of points with mean 0 and covariance 1: on the axes, or a hexagon and its centre, as of a disc."""
    if count == 4:
        r = np.sqrt(2.0)
        return np.array([[r, -r, 0, 0], [0, 0, r, -r], [1 / 4] * 4])
    turn, r = np.pi / 3 * np.arange(6), np.sqrt(8 / 3)
    return np.array([[0, *(r * np.cos(turn))], [0, *(r * np.sin(turn))], [1 / 4, *[1 / 8] * 6]])


def _rings(radii: tuple[float, float], n: int) -> tuple[np.ndarray, np.ndarray]:
    """|u| and weights of n/2 rings: Gauss's rule in |u|² for the density of sums of points of both discs."""
    edge, end = abs(radii[0] - radii[1]), radii[0] + radii[1]
    pieces = [_segment(0.0, edge), _segment(edge, end)] if edge else [_segment(0.0, end)]
    r, w = np.concatenate(pieces, axis=1)
    squares, weights = _gauss(r * r, w * r * _overlap(radii, r), n // 2)
    return np.sqrt(np.maximum(squares, 0.0)), weights


@functools.cache
def _legendre() -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(SEGMENT)


def _segment(low: float, high: float) -> np.ndarray:
    """Nodes and weights in an interval, dense at both ends, where densities have no derivatives."""
    g, w = _legendre()
    turn = 0.5 * np.pi * (1 + g)
    return np.stack([low + 0.5 * (high - low) * (1 - np.cos(turn)), 0.25 * np.pi * (high - low) * np.sin(turn) * w])


def _overlap(radii: tuple[float, float], r: np.ndarray) -> np.ndarray:
    """Area that two discs share whose centres are r apart, r > 0."""
    a, b = radii
    cos_a, cos_b = (np.clip((r * r + p * p - q * q) / (2 * r * p), -1.0, 1.0) for p, q in ((a, b), (b, a)))
    kite = np.sqrt(np.maximum((a + b - r) * (r + a - b) * (r - a + b) * (r + a + b), 0.0))
    return a * a * np.arccos(cos_a) + b * b * np.arccos(cos_b) - 0.5 * kite


def _lens(radii: tuple[float, float], r: np.ndarray) -> _Lens:
    """The lens of a, times the first radius, for each |u| (k,)."""
    a, b = radii
    meet = np.clip((r * r + a * a - b * b) / (2 * r), np.maximum(-a, r - b), np.minimum(a, r + b))
    g, w = _legendre()
    s, w = 0.5 * (1 + g), 0.5 * w
    x, mass, height2 = [], [], []
    # From where a circle's chord is 0, its height goes with the root: x = end + length·s² is smooth.
    for start, centre, radius in ((np.maximum(-a, r - b), r, b), (np.minimum(a, r + b), 0.0 * r, a)):
        length = (meet - start)[:, None]
        at_s = start[:, None] + length * s * s
        half2 = np.maximum(radius**2 - (at_s - centre[:, None]) ** 2, 0.0)
        x.append(at_s)
        height2.append(half2)
        mass.append(2 * s * w * np.abs(length) * np.sqrt(half2))
    x, mass, height2 = (np.concatenate(p, axis=1) for p in (x, mass, height2))
    mass /= mass.sum(axis=1, keepdims=True)
    mean = np.sum(mass * x, axis=1)
    along = np.sum(mass * (x - mean[:, None]) ** 2, axis=1)
    return _Lens(mean, along, np.sum(mass * height2, axis=1) / 3)


def _gauss(x: np.ndarray, weights: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss's rule of n nodes for a measure given by many nodes [Stieltjes's procedure; Golub & Welsch 1969]."""
    weights = weights / weights.sum()
    diagonal, off = np.zeros(n), np.zeros(n)
    before, now, norm = np.zeros_like(x), np.ones_like(x), 1.0
    for k in range(n):
        new = float(np.sum(weights * now * now))
        off[k] = new / norm if k else 0.0
        diagonal[k] = np.sum(weights * x * now * now) / new
        before, now, norm = now, (x - diagonal[k]) * now - off[k] * before, new
    beside = np.sqrt(off[1:])
    nodes, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
    return nodes, vectors[0] ** 2
