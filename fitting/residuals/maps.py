"""Where the residuals of a fit are: maps over two angles."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from gonio.fitting.residuals.pair_angles import PairAngles

HALF_EDGES = (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0)
EVEN_EDGES = tuple(np.arange(0.0, 91.0, 10.0).tolist())
AXES = {"half_difference": ("theta_h", "theta_d"), "incident_outgoing": ("theta_i", "theta_o")}
SYMBOLS = {"theta_h": "θh", "theta_d": "θd", "theta_i": "θi", "theta_o": "θo"}


@dataclasses.dataclass(frozen=True)
class ResidualMap:
    """Median of (model − reading)/|reading| by two angles: `edges` in degrees, values and counts (rows, columns)."""

    axes: tuple[str, str]
    edges: tuple[tuple[float, ...], tuple[float, ...]]
    median_relative: np.ndarray
    count: np.ndarray

    def region(self, row: int, column: int) -> str:
        """A cell of the map in words, such as 'θh 0–1°, θd 10–20°'."""
        said = []
        for name, edges, k in zip(self.axes, self.edges, (row, column), strict=True):
            said.append(f"{SYMBOLS[name]} {edges[k]:g}–{edges[k + 1]:g}°")
        return ", ".join(said)

    def to_dict(self) -> dict:
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


def grouped_median(group: np.ndarray, values: np.ndarray, groups: int) -> np.ndarray:
    """Median of the values of each group (groups,), NaN where it has none."""
    found = np.full(groups, np.nan)
    order = np.argsort(group, kind="stable")
    ends = np.searchsorted(group[order], np.arange(groups + 1))
    for g in np.flatnonzero(np.diff(ends)):
        found[g] = np.median(values[order[ends[g] : ends[g + 1]]])
    return found


def residual_maps(angles: PairAngles, relative: np.ndarray, seen: np.ndarray) -> dict[str, ResidualMap]:
    """Both maps of relative residuals (n, C) where `seen` (n, C)."""
    return {name: residual_map(angles, relative, seen, axes) for name, axes in AXES.items()}


def residual_map(angles: PairAngles, relative: np.ndarray, seen: np.ndarray, axes: tuple[str, str]) -> ResidualMap:
    """One map over two of the angles."""
    edges = tuple(HALF_EDGES if a == "theta_h" else EVEN_EDGES for a in axes)
    index = [bins(getattr(angles, a), e) for a, e in zip(axes, edges, strict=True)]
    rows, columns = len(edges[0]) - 1, len(edges[1]) - 1
    cell = np.broadcast_to((index[0] * columns + index[1])[:, None], seen.shape)[seen]
    median = grouped_median(cell, relative[seen], rows * columns).reshape(rows, columns)
    return ResidualMap(axes, edges, median, np.bincount(cell, minlength=rows * columns).reshape(rows, columns))
