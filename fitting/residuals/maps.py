"""Maps of the relative residuals of a fit over two angles."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from gonio.fitting.residuals.pair_angles import PairAngles

HALF_EDGES = (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0)
EVEN_EDGES = tuple(np.arange(0.0, 91.0, 10.0).tolist())
BEHIND_TOO = tuple(np.arange(0.0, 181.0, 10.0).tolist())
AXES = {"half_difference": ("theta_h", "theta_d"), "incident_outgoing": ("theta_i", "theta_o")}
SYMBOLS = {"theta_h": "θh", "theta_d": "θd", "theta_i": "θi", "theta_o": "θo"}


@dataclasses.dataclass(frozen=True)
class ResidualMap:
    """Median of (model − reading)/|reading| by two angles: `edges` in degrees, values and counts (rows, columns)."""

    axes: tuple[str, ...]
    edges: tuple[tuple[float, ...], ...]
    median_relative: np.ndarray
    count: np.ndarray

    def region(self, row: int, column: int) -> str:
        """A cell of the map in words, such as 'θh 0–1°, θd 10–20°'."""
        return ", ".join(
            f"{SYMBOLS[name]} {edges[k]:g}–{edges[k + 1]:g}°"
            for name, edges, k in zip(self.axes, self.edges, (row, column), strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain lists; NaN where there is no reading."""
        return {
            "axes_deg": list(self.axes),
            "edges_deg": [list(e) for e in self.edges],
            "median_relative": [[float(f"{v:.4g}") for v in row] for row in self.median_relative],
            "count": self.count.tolist(),
        }


def bins(values: np.ndarray, edges: Sequence[float] | np.ndarray) -> np.ndarray:
    """Index of the bin of each value; those on or beyond the last edge belong to the last bin."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def map_cells(angles: PairAngles, axes: Sequence[str], edges: Sequence[Sequence[float]]) -> np.ndarray:
    """Number (n,) of the map's cell, row by row, in which each pair of directions lies."""
    row, column = (bins(getattr(angles, a), e) for a, e in zip(axes, edges, strict=True))
    return row * (len(edges[1]) - 1) + column


def grouped_median(group: np.ndarray, values: np.ndarray, groups: int) -> np.ndarray:
    """Median of the values of each group (groups,), NaN where it has none."""
    medians = np.full(groups, np.nan)
    order = np.argsort(group, kind="stable")
    ends = np.searchsorted(group[order], np.arange(groups + 1))
    for g in np.flatnonzero(np.diff(ends)):
        medians[g] = np.median(values[order[ends[g] : ends[g + 1]]])
    return medians


def _even_edges(angles: np.ndarray) -> tuple[float, ...]:
    """Of bands up to the horizon, or on behind the sample."""
    return EVEN_EDGES if angles.max(initial=0.0) <= EVEN_EDGES[-1] else BEHIND_TOO


def residual_map(angles: PairAngles, relative: np.ndarray, used: np.ndarray, axes: tuple[str, ...]) -> ResidualMap:
    """Map over two of the angles of relative residuals (n, C) where `used` (n, C)."""
    edges = tuple(HALF_EDGES if a == "theta_h" else _even_edges(getattr(angles, a)) for a in axes)
    shape = tuple(len(e) - 1 for e in edges)
    cell = np.broadcast_to(map_cells(angles, axes, edges)[:, None], used.shape)[used]
    median = grouped_median(cell, relative[used], shape[0] * shape[1]).reshape(shape)
    return ResidualMap(axes, edges, median, np.bincount(cell, minlength=median.size).reshape(shape))
