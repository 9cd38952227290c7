"""Values over a file's lists of polar angles and azimuths, in whatever order and sign, on the nodes of a grid."""

from typing import NamedTuple

import numpy as np

DIGITS = 9
"""Decimals of degrees: angles that agree in these are one."""
AGREE = 1e-6
"""Relative difference up to which repeated readings of a direction agree: files print six digits."""


class Nodes(NamedTuple):
    """Values on the nodes of a grid."""

    polar: np.ndarray
    """Degrees, none negative, increasing."""
    azimuth: np.ndarray
    """Degrees in [0, 360), increasing."""
    values: np.ndarray
    """(..., polar, azimuth); NaN where the file has none."""
    missing: np.ndarray
    """(polar, azimuth): whether the file has no value there."""
    repeated: int
    """Pairs of angles that stand for a direction which another has already."""
    disagreeing: int
    """Directions whose repeated values are not the same."""


def on_nodes(polar: np.ndarray, azimuth: np.ndarray, values: np.ndarray, pole: bool = True) -> Nodes:
    """The values of a file's lists on a grid; the mean where a direction is there more than once.

    Args:
        polar: degrees, in any order; a negative angle stands for its absolute value half a turn on.
        azimuth: degrees, in any order and of any turn.
        values: (..., polar, azimuth).
        pole: whether the values at the polar angle 0 are one direction's, so that one stands for all azimuths.
    """
    p, a = np.meshgrid(polar, azimuth, indexing="ij")
    a = np.where(p < 0, a + 180.0, a)
    p, a = _rounded(np.abs(p), a)
    rows, row = np.unique(p, return_inverse=True)
    columns, column = np.unique(a, return_inverse=True)
    cell = row.reshape(-1) * columns.size + column.reshape(-1)
    order = np.argsort(cell, kind="stable")
    there, start, count = np.unique(cell[order], return_index=True, return_counts=True)
    flat = values.reshape(*values.shape[:-2], -1)[..., order]
    single = count == 1
    mean = np.add.reduceat(flat, start, axis=-1) / count
    spread = np.maximum.reduceat(flat, start, axis=-1) - np.minimum.reduceat(flat, start, axis=-1)
    differ = (spread > AGREE * np.abs(mean)).reshape(-1, there.size).any(axis=0) & ~single
    result = np.full((*values.shape[:-2], rows.size * columns.size), np.nan)
    result[..., there] = np.where(differ | single, mean, flat[..., start])
    missing = np.ones(rows.size * columns.size, bool)
    missing[there] = False
    result, missing = (x.reshape(*x.shape[:-1], rows.size, columns.size) for x in (result, missing))
    if pole and rows[0] == 0 and missing[0].any() and not missing[0].all():
        result[..., 0, missing[0]] = result[..., 0, ~missing[0]].mean(axis=-1, keepdims=True)
        missing[0] = False
    return Nodes(rows, columns, result, missing, int(np.sum(count - 1)), int(differ.sum()))


def _rounded(polar: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turn = np.round(azimuth % 360.0, DIGITS)
    return np.round(polar, DIGITS), np.where(turn >= 360.0, 0.0, turn) + 0.0
