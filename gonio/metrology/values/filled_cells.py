"""Cells of a grid that have no reading, by those beside them: what interpolation would have taken there."""

from typing import NamedTuple

import numpy as np

from gonio.data.layouts import Layout
from gonio.metrology.standards.of_tables import WITHIN


class FilledCells(NamedTuple):
    """f (cells, C) with what lines along the axes make of cells without a reading, NaN where none reaches them, and
    how far off they may be (cells, C): by how the lines disagree, or by all of it where there is but one; 0 where a
    reading is."""

    f: np.ndarray
    bound: np.ndarray


def filled_cells(layout: Layout, f: np.ndarray) -> FilledCells:
    """Those of readings f (cells, C), NaN where there is none.

    A line goes through the readings on both sides of a cell, else on through two on one side.
    """
    known = np.isfinite(f)
    if known.all():
        return FilledCells(f, np.zeros(f.shape))
    whole = f.reshape(*layout.shape, f.shape[-1])
    between, beyond = [], []
    for axis, (name, nodes) in enumerate(layout.axes.items()):
        if nodes.size < 2:
            continue
        rows, period = np.moveaxis(whole, axis, 0), layout.periods[name]
        places = _extended(nodes, period)
        ends = (rows[-2:], rows[:2]) if period is not None else (_nothing(rows), _nothing(rows))
        values = np.concatenate([ends[0], rows, ends[1]])
        inner = np.arange(2, nodes.size + 2)
        lines = [_line(values, places, inner, *pair) for pair in ((-1, 1), (-1, -2), (1, 2))]
        both, *one = (np.moveaxis(line, 0, axis).reshape(f.shape) for line in lines)
        between.append(both)
        beyond += one
    made = _joined(np.stack(between + beyond), len(between))
    return FilledCells(np.where(known, f, made.f), np.where(known, 0.0, made.bound))


def _joined(lines: np.ndarray, between: int) -> FilledCells:
    """The mean of what lines (n, cells, C) make of cells, of the first so many where any of these reaches one."""
    inner = np.isfinite(lines[:between]).any(axis=0)
    lines = np.concatenate([lines[:between], np.where(inner, np.nan, lines[between:])])
    there = np.isfinite(lines)
    number = there.sum(axis=0)
    mean = np.where(number > 0, np.sum(np.where(there, lines, 0.0), axis=0) / np.maximum(number, 1), np.nan)
    spread = np.max(np.where(there, lines, -np.inf), axis=0) - np.min(np.where(there, lines, np.inf), axis=0)
    return FilledCells(mean, np.where(number > 1, WITHIN * spread, np.where(number > 0, np.abs(mean), 0.0)))


def _line(values: np.ndarray, places: np.ndarray, rows: np.ndarray, first: int, second: int) -> np.ndarray:
    """Values (n, ...) at rows by the line through those so many rows away."""
    a, b = places[rows + first], places[rows + second]
    with np.errstate(invalid="ignore", divide="ignore"):
        t = ((places[rows] - a) / (b - a)).reshape(-1, *[1] * (values.ndim - 1))
        return values[rows + first] + t * (values[rows + second] - values[rows + first])


def _extended(nodes: np.ndarray, period: float | None) -> np.ndarray:
    """Nodes with two more at both ends: of a periodic axis its own, else places where nothing was read."""
    if period is None:
        return np.concatenate([nodes[0] - [2.0, 1.0], nodes, nodes[-1] + [1.0, 2.0]])
    return np.concatenate([nodes[-2:] - period, nodes, nodes[:2] + period])


def _nothing(rows: np.ndarray) -> np.ndarray:
    return np.full((2, *rows.shape[1:]), np.nan)
