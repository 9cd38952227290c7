"""The grid that a list of directions is: in the plane, isotropic, spherical, half/difference, about the mirror."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gonio.data.layouts.angle_layouts import in_plane, isotropic, spherical
from gonio.data.layouts.base import SAME, TURN, Layout
from gonio.data.layouts.half_difference_grid import half_difference
from gonio.data.layouts.mirror_grid import mirror
from gonio.models.geometry.sides import side

FEWEST = 8
"""Directions of a grid, at least: fewer are listed as they are."""
MOST_OF_CELLS = 0.5
"""Share of a grid's cells above the horizon that a list must have more than."""
LEAST_OF_NODE = 0.25
"""The same for the cells of each node of each axis."""
LARGEST_ROUNDING = 5e-4
"""Radians: what is printed with fewer digits is taken as exact."""
MOST_BELOW_HORIZON = 8
"""Cells of a grid for each listed direction, at most: a half/difference grid has most of them below the horizon."""

Angles = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""theta_i, phi_i, theta_o, phi_o of each pair of directions, radians, (n,)."""


class Placement(NamedTuple):
    """A grid and what of a list stands in its cells."""

    layout: Layout
    cells: np.ndarray
    """Cell of each listed pair, in C order; several may share one."""
    origins: np.ndarray
    """For each cell the one that has its reading: itself, or at a pole, where azimuth has no meaning, the only read."""
    turned: float = 0.0
    """Azimuth of the light in the list, radians, where that is 0 in the grid."""


def recognised(angles: Angles, rounding: float = 0.0, front: bool = False) -> Placement | None:
    """The grid whose cells a list of directions are, most of them, in any order; None where there is none.

    Args:
        angles: theta_i, phi_i, theta_o, phi_o, radians; polar angles in [0, π], azimuths in [0, 2π).
        rounding: radians by which printing may have moved an angle; beyond `LARGEST_ROUNDING` angles are exact.
        front: whether directions beyond π/2 are what half angles have below the horizon, rather than behind the sample.
    """
    tolerance = (2.02 * rounding if rounding <= LARGEST_ROUNDING else 0.0) + SAME
    if angles[0].size < FEWEST:
        return None
    behind = not front and any((side(np.cos(a)) < 0).any() for a in (angles[0], angles[2]))
    kinds = KINDS_OF_BOTH_SIDES if behind else KINDS
    return next((p for kind in kinds for p in kind(angles, tolerance) if p is not None), None)


def _in_plane(angles: Angles, tolerance: float) -> Iterator[Placement | None]:
    turn = _light_along_x(angles, tolerance)
    if turn is None:
        return
    theta_i, theta_o = _polar_nodes(angles, tolerance)
    delta = angles[3] - turn
    if ((np.abs(np.sin(delta)) > tolerance) & _off_pole(theta_o)).any():
        return
    signed = np.where(np.cos(delta) > 0, -theta_o, theta_o) + 0.0
    yield _placed(in_plane, (theta_i, signed), turn)


def _isotropic(angles: Angles, tolerance: float) -> Iterator[Placement | None]:
    turn = _light_along_x(angles, tolerance)
    if turn is not None:
        theta_i, theta_o = _polar_nodes(angles, tolerance)
        away = _off_pole(theta_i) & _off_pole(theta_o)
        delta = _azimuth_nodes(_on_near_side(angles[3] - turn, away, tolerance), tolerance, away)
        delta = _distinct((theta_i, theta_o), delta, ~_off_pole(theta_o))
        yield _placed(isotropic, (theta_i, theta_o, delta), turn)


def _spherical(angles: Angles, tolerance: float) -> Iterator[Placement | None]:
    theta_i, theta_o = _polar_nodes(angles, tolerance)
    phi_i = _azimuth_nodes(angles[1], tolerance, _off_pole(theta_i))
    phi_o = _azimuth_nodes(angles[3], tolerance, _off_pole(theta_o))
    phi_i = _distinct((theta_i, theta_o, phi_o), phi_i, ~_off_pole(theta_i))
    phi_o = _distinct((theta_i, theta_o, phi_i), phi_o, ~_off_pole(theta_o))
    yield _placed(spherical, (theta_i, phi_i, theta_o, phi_o))


def _half_difference(angles: Angles, tolerance: float) -> Iterator[Placement | None]:
    """Without the azimuth of the half vector: the surface is taken as isotropic, as such tables take it."""
    theta_h, phi_h, theta_d, phi_d = half_difference_angles(angles)
    error_h = tolerance / np.maximum(np.cos(theta_d), 1e-3)
    error_phi_h = error_h / np.maximum(np.sin(theta_h), 1e-9)
    turn = _light_along_x(angles, tolerance)
    if turn is None:
        if (np.abs(_wrapped(phi_h)) > 4 * error_phi_h).any():
            return
        phi_d = half_difference_angles(angles, np.zeros_like(phi_h))[3]
    h = _nodes_of(theta_h, error_h)
    d = _nodes_of(theta_d, np.full_like(theta_d, tolerance))
    error_p = error_h / np.maximum(np.sin(theta_d), 1e-9) + (0.0 if turn is None else error_phi_h)
    clear = error_p <= 4 * np.median(error_p)
    full = (_wrapped(phi_d[clear] - math.pi / 2) >= math.pi / 2 - 4 * np.median(error_p)).any()
    p = _nodes_of(phi_d, error_p, TURN if full else math.pi)
    if h is None or d is None or p is None:
        return
    free = (error_p > np.diff(p[0]).min(initial=math.pi) / 8) | (d[0][d[1]] == 0)
    phi = _distinct((h[0][h[1]], d[0][d[1]]), p[0][p[1]], free)
    yield _placed(half_difference, (h[0][h[1]], d[0][d[1]], phi), turn or 0.0)


def _mirror(angles: Angles, tolerance: float) -> Iterator[Placement | None]:
    turn = _light_along_x(angles, tolerance)
    if turn is None:
        return
    incidence = _clusters(angles[0], tolerance)
    theta_i, phi = incidence[0][incidence[1]], angles[3] - turn
    x, y, z = np.sin(angles[2]) * np.cos(phi), np.sin(angles[2]) * np.sin(phi), np.cos(angles[2])
    along, up = np.cos(theta_i) * z - np.sin(theta_i) * x, np.cos(theta_i) * x + np.sin(theta_i) * z
    theta_m = np.arctan2(np.hypot(up, y), along)
    phi_m = _on_near_side(np.arctan2(y, up), theta_m > 100 * tolerance, 100 * tolerance)
    m = _nodes_of(theta_m, np.full_like(theta_m, tolerance))
    error_p = tolerance / np.maximum(np.sin(theta_m), 1e-9)
    p = _nodes_of(phi_m, error_p, TURN)
    if m is None or p is None:
        return
    free = (error_p > np.diff(p[0]).min(initial=math.pi) / 8) | (m[0][m[1]] == 0)
    azimuth = _distinct((theta_i, m[0][m[1]]), p[0][p[1]], free)
    yield _placed(mirror, (theta_i, m[0][m[1]], azimuth), turn)


KINDS: tuple[Callable[[Angles, float], Iterator[Placement | None]], ...] = (
    _in_plane,
    _isotropic,
    _spherical,
    _half_difference,
    _mirror,
)
"""From the fewest dimensions up."""
KINDS_OF_BOTH_SIDES = KINDS[:3]
"""Those that hold directions behind the sample."""


def half_difference_angles(angles: Angles, phi_h: np.ndarray | None = None) -> Angles:
    """theta_h, phi_h, theta_d, phi_d of pairs of directions, azimuths in [0, 2π); `phi_h` where it is known."""
    light, detector = angles[:2], angles[2:]
    wi, wo = (np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)]) for t, p in (light, detector))
    total, difference = wi + wo, wi - wo
    theta_h = np.arctan2(np.hypot(total[0], total[1]), total[2])
    phi_h = np.where(theta_h > SAME, np.arctan2(total[1], total[0]), 0.0) if phi_h is None else phi_h
    theta_d = np.arctan2(np.linalg.norm(difference, axis=0), np.linalg.norm(total, axis=0))
    x = wi[0] * np.cos(phi_h) + wi[1] * np.sin(phi_h)
    y = wi[1] * np.cos(phi_h) - wi[0] * np.sin(phi_h)
    phi_d = np.arctan2(y, x * np.cos(theta_h) - wi[2] * np.sin(theta_h))
    return theta_h, phi_h % TURN, theta_d, phi_d % TURN


def _off_pole(theta: np.ndarray) -> np.ndarray:
    """Whether directions at these nodes have an azimuth."""
    return (theta > 0) & (theta < math.pi - SAME)


def _light_along_x(angles: Angles, tolerance: float) -> float | None:
    """The one azimuth, 0 or π, that the light has wherever it is off the normal; None where it has others.

    Turned by any other angle, axes of an anisotropic sample would no longer be where they were.
    """
    azimuths = angles[1][(angles[0] > tolerance) & (angles[0] < math.pi - tolerance)]
    one = float(azimuths[0]) if azimuths.size else float(angles[1][0])
    same = (np.abs(_wrapped(azimuths - one)) <= tolerance).all()
    return one if same and abs(math.sin(one)) <= tolerance else None


def _polar_nodes(angles: Angles, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """theta_i and theta_o at their nodes, which they share: exchanged directions are looked for at equal ones."""
    nodes, numbers = _clusters(np.concatenate([angles[0], angles[2]]), tolerance)
    values = nodes[numbers]
    return values[: angles[0].size], values[angles[0].size :]


def _azimuth_nodes(phi: np.ndarray, tolerance: float, meant: np.ndarray) -> np.ndarray:
    """Azimuths at their nodes, radians in [0, 2π); where they are not `meant` (at a pole) at the nearest node."""
    if not meant.any():
        meant = np.ones_like(meant)
    nodes, _ = _clusters(phi[meant], tolerance, TURN)
    return nodes[_nearest(nodes, phi, TURN)]


def _on_near_side(azimuth: np.ndarray, meant: np.ndarray, tolerance: float) -> np.ndarray:
    """Azimuths in [0, 2π), mirrored where all lie beyond half a turn: grids of one side have that between 0 and π."""
    far = (np.sin(azimuth[meant]) <= tolerance).all() and (np.sin(azimuth[meant]) < -tolerance).any()
    return (-azimuth if far else azimuth) % TURN


def _nodes_of(
    values: np.ndarray, errors: np.ndarray, period: float | None = None
) -> tuple[np.ndarray, np.ndarray] | None:
    """(nodes, number of the node of each value) by the best known values; None where one is no node."""
    clear = errors <= 4 * np.median(errors)
    nodes, _ = _clusters(values[clear], 4 * float(np.median(errors)), period)
    numbers = _nearest(nodes, values, period)
    off = np.abs(_wrapped(values - nodes[numbers], period)) if period else np.abs(values - nodes[numbers])
    uncertain = errors > np.diff(nodes).min(initial=math.pi) / 8
    return None if ((off > 5 * errors) & ~uncertain).any() else (nodes, numbers)


def _clusters(values: np.ndarray, tolerance: float, period: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(nodes in order, number of the node of each value): values apart by no more than the tolerance are one node."""
    if period is not None:
        values = (values + 2 * tolerance) % period - 2 * tolerance
    distinct, back = np.unique(values, return_inverse=True)
    number = np.concatenate([[0], np.cumsum(np.diff(distinct) > tolerance)])
    first, last = (np.searchsorted(number, np.arange(number[-1] + 1), side=s) for s in ("left", "right"))
    nodes = distinct[(first + last - 1) // 2]
    return _round(nodes, tolerance, period), number[back.reshape(-1)]


def _round(nodes: np.ndarray, tolerance: float, period: float | None) -> np.ndarray:
    """Nodes at the round degrees or the even steps that they are within the tolerance."""
    degrees = np.degrees(nodes)
    for decimals in range(9):
        step = math.radians(10.0**-decimals)
        rounded = np.radians(np.round(degrees, decimals)) + 0.0
        if step > 20 * tolerance and (np.abs(rounded - nodes) <= tolerance).all():
            return rounded
    k = np.arange(nodes.size)
    for power in (1.0, 2.0):
        root = np.maximum(nodes, 0.0) ** (1 / power)
        start = 0.0 if nodes[0] <= 2 * tolerance else root[0]
        step = (root[-1] - start) / max(nodes.size - 1, 1)
        if period is not None and abs(nodes.size * step - period) <= 4 * nodes.size * tolerance:
            step = period / nodes.size
        even = (start + step * k) ** power
        if nodes.size > 3 and (np.abs(even - nodes) <= 2 * tolerance).all():
            return even
    return nodes + 0.0


def _nearest(nodes: np.ndarray, values: np.ndarray, period: float | None = None) -> np.ndarray:
    """Number of the node nearest to each value."""
    edges = (nodes[1:] + nodes[:-1]) / 2
    if period is None:
        return np.searchsorted(edges, values)
    seam = (nodes[-1] + nodes[0] - period) / 2
    return np.searchsorted(edges, (values - seam) % period + seam)


def _wrapped(angle: np.ndarray, period: float = TURN) -> np.ndarray:
    """Angles in [−period/2, period/2)."""
    return (angle + period / 2) % period - period / 2


def _distinct(others: Sequence[np.ndarray], azimuth: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Azimuths; those that are `free`, as they mean nothing there, at nodes of their own where one stands twice."""
    if not free.any():
        return azimuth
    nodes = np.unique(azimuth)
    rows = np.flatnonzero(free)
    key = np.unique(np.stack([o[rows] for o in others]), axis=1, return_inverse=True)[1].reshape(-1)
    pairs = np.unique(np.stack([key, np.searchsorted(nodes, azimuth[rows])]), axis=1)
    single = np.bincount(pairs[0], minlength=key.max() + 1) == np.bincount(key)
    order = np.argsort(key, kind="stable")
    occurrence = np.empty(rows.size, np.intp)
    occurrence[order] = np.arange(rows.size) - np.searchsorted(key[order], key[order])
    result = azimuth.copy()
    result[rows] = np.where(single[key], azimuth[rows], nodes[occurrence % nodes.size])
    return result


def _placed(make: Callable[..., Layout], values: Sequence[np.ndarray], turned: float = 0.0) -> Placement | None:
    """The grid of these values on its axes (n,), and where each stands; None where the list is not most of it."""
    axes: list[ArrayLike] = [np.unique(v) for v in values]
    if math.prod(np.size(a) for a in axes) > MOST_BELOW_HORIZON * values[0].size:
        return None
    layout = make(*axes)
    numbers = [np.searchsorted(a, v) for a, v in zip(axes, values, strict=True)]
    cells = np.ravel_multi_index(numbers, layout.shape)
    there = np.zeros(layout.size, bool)
    there[cells] = True
    origins = _pole_origins(layout, there)
    return Placement(layout, cells, origins, turned) if _covers(layout, there[origins]) else None


def _pole_origins(layout: Layout, there: np.ndarray) -> np.ndarray:
    """For each cell the one whose reading it has: at a pole the only one that was read over all azimuths."""
    origins = np.arange(layout.size).reshape(layout.shape)
    names = list(layout.axes)
    for polar, azimuth in layout.pole_axes:
        for node in layout.pole_nodes(polar):
            pole = tuple(node if name == polar else slice(None) for name in names)
            part = origins[pole]
            read = there[part]
            along = [n for n in names if n != polar].index(azimuth)
            sole = read.sum(along, keepdims=True) == 1
            only = np.take_along_axis(part, np.argmax(read, along, keepdims=True), along)
            origins[pole] = np.where(sole, only, part)
    return origins.reshape(-1)


def _covers(layout: Layout, there: np.ndarray) -> bool:
    """Whether most of the cells above the horizon are there, and some at every node away from a pole."""
    above = layout.readable().reshape(layout.shape)
    read = there.reshape(layout.shape) & above
    if read.sum() <= MOST_OF_CELLS * above.sum():
        return False
    poles = {polar for polar, _ in layout.pole_axes}
    for k, name in enumerate(layout.axes):
        others = tuple(j for j in range(len(layout.shape)) if j != k)
        few = read.sum(others) < LEAST_OF_NODE * above.sum(others)
        if np.delete(few, layout.pole_nodes(name) if name in poles else []).any():
            return False
    return True
