"""How far readings of a grid lie off the line through their neighbours: what interpolation may miss between them."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gonio.data.interpolation.grid_boxes import GridBoxes
from gonio.data.layouts import Layout

NOISE = 2 * 1.22
"""Standard uncertainties by which the mean of two neighbours may differ from a reading without a structure."""
MOST_UNEVEN = 16.0
"""Of two steps beside a node of which one is far smaller than the other the larger counts as so many times it."""
POLES = {"theta_i": ("phi_i", "delta_phi"), "theta_o": ("phi_o", "delta_phi"), "theta_m": ("phi_m",)}
"""Angles from a pole, and the azimuths about it by which a line goes on beyond it."""
NEAR = 0.2
"""Radians between an azimuth that was read and the opposite of another, up to which it stands for that."""
COVERAGE = 2.0
"""Standard uncertainties of a sum of such differences that bound it."""


class Bend(NamedTuple):
    """Readings of n cells along one axis: (3, n) numbers of the cells before, at and after each, the share t (n,) of
    the way between them, one over the product of the steps (n,), by which differences become curvatures, the readings
    there (3, n, C), their uncertainties, and the least f that counts (C,)."""

    cells: np.ndarray
    t: np.ndarray
    scale: np.ndarray
    f: np.ndarray
    u: np.ndarray
    floor: np.ndarray

    def straight(self) -> np.ndarray:
        """f less that of the line through its neighbours (n, C), over the product of the steps: minus a half of f''.

        NaN where one was not read.
        """
        low, middle, high = self.f
        return self._scaled(middle - (1 - self.t)[:, None] * low - self.t[:, None] * high)

    def noise(self) -> np.ndarray:
        """What noise may make of that (n, C)."""
        return self._scaled(NOISE * self.u)

    def _scaled(self, difference: np.ndarray) -> np.ndarray:
        return self.scale[:, None] * difference

    def beyond_noise(self) -> tuple[np.ndarray, np.ndarray]:
        """|f − that of the line| (n, C), and of log f, over the product of the steps, less what noise makes of them."""
        size = np.maximum(np.nan_to_num(self.f[1]), self.floor)
        low, middle, high = np.log(np.maximum(self.f, self.floor))
        share = self._scaled(np.abs(middle - (1 - self.t)[:, None] * low - self.t[:, None] * high))
        noise = self.noise()
        return _without_gaps(np.abs(self.straight()) - noise), _without_gaps(share - noise / size)


@dataclasses.dataclass
class Bends:
    """Sums over cells of what bends within the noise: it has a sign, so that noise averages out of it."""

    layout: Layout
    f: np.ndarray
    u: np.ndarray
    total: np.ndarray
    cells: list[np.ndarray]
    weights: list[np.ndarray]

    @classmethod
    def of(cls, layout: Layout, f: np.ndarray, u: np.ndarray) -> "Bends":
        """Of readings f (cells, C), NaN where there is none, and their standard uncertainties."""
        return cls(layout, f, u, np.zeros(f.shape[1]), [], [])

    def along(self, axis: int, cells: np.ndarray, floor: np.ndarray) -> Bend:
        """The readings of some cells along one axis, by its number."""
        name = list(self.layout.axes)[axis]
        nodes, index = self.layout.axes[name], np.array(np.unravel_index(cells, self.layout.shape))
        if nodes.size < 2:  # nothing is known of what lies beside it
            three, t, span = (index[axis],) * 3, np.zeros(cells.size), np.ones(cells.size)
        else:
            mirrored = name in self.layout.mirrored_axes
            *three, t, span = neighbours(nodes, index[axis], self.layout.periods[name], mirrored)
        places = np.stack(
            [np.ravel_multi_index((*index[:axis], k, *index[axis + 1 :]), self.layout.shape) for k in three]
        )
        if (beyond := _beyond_pole(self.layout, name, index)) is not None:
            # A lobe at the pole is a peak there, not what goes on from the nodes on one side
            pole, there = beyond
            beside = np.ravel_multi_index((*index[:axis], np.ones_like(cells), *index[axis + 1 :]), self.layout.shape)
            places[:, pole] = np.stack([there, cells, beside])[:, pole]
            t, span = np.where(pole, 0.5, t), np.where(pole, 2 * (nodes[1] - nodes[0]), span)
        inner = (t > 0) & (t < 1)
        scale = 1 / (span**2 * np.where(inner, np.maximum(t * (1 - t), 1 / MOST_UNEVEN), 1.0))
        return Bend(places, t, scale, self.f[places], self.u[cells], floor)

    def add(self, bend: Bend, share: np.ndarray) -> None:
        """Count shares (n,), squares of steps, of what the cells' readings bend by within their noise."""
        noise = bend.noise()
        inside = np.clip(np.nan_to_num(bend.straight()), -noise, noise)
        self.total = self.total + share @ inside
        self.cells.append(bend.cells.ravel())
        self.weights.append((share * bend.scale * np.stack([bend.t - 1, np.ones(share.size), -bend.t])).ravel())

    def within_noise(self) -> np.ndarray:
        """Bound (C,) of that sum: its size and what noise may have taken from it."""
        which, place = np.unique(np.concatenate(self.cells), return_inverse=True)
        weight = np.bincount(place, np.concatenate(self.weights), which.size)
        return np.abs(self.total) + COVERAGE * np.sqrt(weight**2 @ self.u[which] ** 2)


def _beyond_pole(layout: Layout, name: str, index: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Which cells (n,) of these indices (axes, n) are at the pole of an angle, and the cell one step beyond it.

    None where the angle has none, or its other side was not read.
    """
    around = [a for a in POLES.get(name, ()) if a in layout.axes]
    nodes = layout.axes[name]
    turns_with = name == "theta_i" and {"phi_i", "delta_phi"} <= layout.axes.keys()
    if not around or turns_with or nodes.size < 2 or abs(nodes[0]) > 1e-9:
        return None
    axis, azimuth = list(layout.axes).index(name), list(layout.axes).index(around[0])
    phi = layout.axes[around[0]]
    opposite = phi + np.pi
    if around[0] in layout.mirrored_axes:
        opposite = np.where(opposite > np.pi, 2 * np.pi - opposite, opposite)
    off = np.abs(np.mod(phi - opposite[:, None] + np.pi, 2 * np.pi) - np.pi)
    other = np.argmin(off, axis=1)
    pole = (index[axis] == 0) & (np.min(off, axis=1) < NEAR)[index[azimuth]]
    beyond = index.copy()
    beyond[axis], beyond[azimuth] = 1, other[index[azimuth]]
    return pole, np.asarray(np.ravel_multi_index(tuple(beyond), layout.shape))


def _without_gaps(error: np.ndarray) -> np.ndarray:
    """Errors (n, C), where none is known the usual one."""
    known = np.isfinite(error)
    if known.all():
        return np.maximum(error, 0.0)
    usual = np.nanmedian(error, axis=0) if known.any() else np.zeros(error.shape[1])
    return np.maximum(np.where(known, error, np.nan_to_num(usual)), 0.0)


def neighbours(
    nodes: np.ndarray, k: np.ndarray, period: float | None, mirrored: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(lower, middle, upper) nodes, the middle's share of the way between the others, and the way.

    At the end of an axis the node beside it is the middle one; a periodic axis has no end, a mirrored one goes on as
    its image; of two nodes the lower stands for the middle and the upper is the other.
    """
    n = nodes.size
    if n == 2 and period is None:
        return np.zeros_like(k), np.zeros_like(k), np.ones_like(k), np.ones(k.size), np.full(k.size, np.ptp(nodes))
    if period is not None or mirrored:
        before, after = (nodes[-1] - (period or 0), nodes[0] + (period or 0))
        first, last = (n - 1, 0) if period is not None else (min(1, n - 1), max(n - 2, 0))
        if mirrored:
            before, after = -nodes[first], 2 * np.pi - nodes[last]
        low, high = np.where(k > 0, k - 1, first), np.where(k < n - 1, k + 1, last)
        below, above = np.where(k > 0, nodes[low], before), np.where(k < n - 1, nodes[high], after)
        return low, k, high, (nodes[k] - below) / (above - below), above - below
    middle = np.clip(k, 1, n - 2)
    span = nodes[middle + 1] - nodes[middle - 1]
    return middle - 1, middle, middle + 1, (nodes[middle] - nodes[middle - 1]) / span, span


def curvatures(layout: Layout, boxes: GridBoxes, x: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """t(1 − t) times the step's square (n,) of each axis, in the order of the boxes: what f'' / 2 has to be multiplied
    by for the error of a line."""
    curved = []
    for name, ((low, high), (a, b)) in zip(layout.axes, boxes.sides, strict=True):
        nodes, period = layout.axes[name], layout.periods[name]
        first = nodes[1] - nodes[0] if nodes.size > 1 else 1.0
        outside = np.maximum(nodes[0] - x[name][boxes.order], 0.0) / first if period is None else 0.0
        step = np.abs(nodes[high] - nodes[low]) if period is None else np.mod(nodes[high] - nodes[low], period)
        curved.append((a * b + outside * (1 + outside)) * np.where(step > 0, step, first) ** 2)
    return curved
