"""Cells of a grid that have no reading, by those beside them: what interpolation would have taken there."""

from typing import NamedTuple

import numpy as np

from gonio.data.layouts import Layout
from gonio.metrology.standards.of_tables import WITHIN

LINES = ((-1, 1), (-1, -2), (1, 2))
"""Nodes, from a cell on, through which a line goes: on both sides of it, or two on one side."""


class FilledCells(NamedTuple):
    """f (n, C) of cells, where there is no reading by lines along the axes, NaN where none reaches; and how far off
    that may be (n, C): by how the lines disagree, or by all of it where there is but one; 0 where a reading is."""

    f: np.ndarray
    bound: np.ndarray


def filled_cells(layout: Layout, f: np.ndarray, cells: np.ndarray) -> FilledCells:
    """Those of some cells (n,), by their numbers, of readings f (all cells, C), NaN where there is none.

    Lines go through the readings on both sides of a cell, else on through two on one side.
    """
    made, bound = f[cells], np.zeros((cells.size, f.shape[-1]))
    missing = np.flatnonzero(~np.isfinite(made).all(axis=1))
    if not missing.size:
        return FilledCells(made, bound)
    index = np.stack(np.unravel_index(cells[missing], layout.shape))
    axes = [k for k, nodes in enumerate(layout.axes.values()) if nodes.size > 1]
    lines = np.stack([[_line(layout, f, index, axis, *pair) for axis in axes] for pair in LINES])
    filled, off = _joined(lines[0], lines[1:].reshape(-1, *lines.shape[2:]))
    known = np.isfinite(made[missing])
    made[missing] = np.where(known, made[missing], filled)
    bound[missing] = np.where(known, 0.0, off)
    return FilledCells(made, bound)


def _joined(between: np.ndarray, beyond: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean of lines (k, n, C), of those on both sides where there is one, and how far off it may be."""
    inner = np.isfinite(between).any(axis=0)
    lines = np.concatenate([between, np.where(inner, np.nan, beyond)])
    there = np.isfinite(lines)
    number = there.sum(axis=0)
    mean = np.where(number > 0, np.sum(np.where(there, lines, 0.0), axis=0) / np.maximum(number, 1), np.nan)
    spread = np.max(np.where(there, lines, -np.inf), axis=0) - np.min(np.where(there, lines, np.inf), axis=0)
    return mean, np.where(number > 1, WITHIN * spread, np.nan_to_num(np.abs(mean)))


def _line(layout: Layout, f: np.ndarray, index: np.ndarray, axis: int, first: int, second: int) -> np.ndarray:
    """f (n, C) at cells of indices (axes, n) by the line through the nodes so many steps away along an axis."""
    (a, low), (b, high) = (_beside(layout, f, index, axis, step) for step in (first, second))
    nodes = list(layout.axes.values())[axis]
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (nodes[index[axis]] - a) / (b - a)
        return low + t[:, None] * (high - low)


def _beside(layout: Layout, f: np.ndarray, index: np.ndarray, axis: int, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (n,) along an axis so many steps from cells, and the readings there (n, C), NaN beyond its ends."""
    name, nodes = list(layout.axes.items())[axis]
    period, there = layout.periods[name], index[axis] + step
    inside = np.ones(there.size, bool) if period is not None else (there >= 0) & (there < nodes.size)
    turns, number = np.divmod(np.where(inside, there, 0), nodes.size)
    moved = index.copy()
    moved[axis] = number
    readings = np.where(inside[:, None], f[np.ravel_multi_index(tuple(moved), layout.shape)], np.nan)
    return nodes[number] + turns * (period or 0.0), readings
