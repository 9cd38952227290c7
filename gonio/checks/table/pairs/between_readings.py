"""Values of a table between its readings, with how far they may be off."""

import dataclasses
from typing import NamedTuple, cast

import numpy as np

from gonio.checks.certificate import relative_difference
from gonio.checks.direction_search import values
from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.pair_points import EXACT, LEAF, isotropic_light, one_sided, pair_points
from gonio.checks.table.pairs.places import angles_of, pair_angles
from gonio.checks.table.pairs.scattered_pairs import STEEPEST
from gonio.data.interpolation.coverage import covered
from gonio.data.interpolation.multilinear import Tabulated, as_material, coarsened
from gonio.data.interpolation.two_sided import TwoSided
from gonio.data.table import Table
from gonio.models.geometry.directions import Direction

MOST_READINGS = 200_000
"""Of a table, in which the one that is nearest is looked for."""
ACROSS = 2.0
"""Distance to the nearest reading in those between the readings on both sides of a direction."""
FARTHEST, TOGETHER = np.radians(45.0), 512
"""Of those readings; directions that are looked at together, each of which may have many."""
NEIGHBOURS = 6
"""Scattered readings around a direction, which show how much f changes there."""


class Between(NamedTuple):
    """Values (n, C), NaN where nothing was read or f is too steep to interpolate, and what is known of them.

    Attributes:
        error: relative, by half of the readings: of a grid that resolves f three times its own.
        around: by how much the readings around differ, 1/sr: a bound of whatever is monotone between them; 0 where
            there is a reading, NaN where one around is missing.
        gap: (n,), about radians, to the nearest reading of a list; 0 of a grid.
    """

    value: np.ndarray
    error: np.ndarray
    around: np.ndarray
    gap: np.ndarray


def between_readings(table: Table, wi: Direction, wo: Direction) -> Between:
    """f of a table at pairs of directions (n,); a reading itself where there is one.

    Raises GonioError where the table cannot be interpolated.
    """
    inside = covered(table, wi, wo)
    material = as_material(table)
    value = values(material, wi, wo)
    # What a format reads by a rule of its own is what it states.
    rough = value if table.interpolant is not None else values(as_material(coarsened(table)), wi, wo)
    error = relative_difference(value, rough)
    gap = np.zeros(len(value))
    if table.interpolant is not None:
        around = np.zeros(value.shape)
    elif table.layout.gridded:
        least, most = cast(Tabulated | TwoSided, material).ends(wi, wo)
        around = most - least
        error = np.where(around == 0, 0.0, error)
    else:
        value, error, around, gap = _between_scattered(table, pair_angles(wi, wo), value, error)
    return Between(np.where(inside[:, None] & (error <= STEEPEST), value, np.nan), error, around, gap)


def uncertainty_between(table: Table, wi: Direction, wo: Direction) -> np.ndarray:
    """Standard uncertainties (n, C) of such values, as if those of the readings around were one; NaN: not stored."""
    if table.u_f is None or table.interpolant is not None:
        return np.full((wi.z.size, len(table.channels)), np.nan)
    return values(as_material(dataclasses.replace(table, f=table.u_f)), wi, wo)


def _between_scattered(
    table: Table, angles: np.ndarray, value: np.ndarray, error: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(value, error, around, gap) by the nearest readings: a reading that is there counts itself."""
    cells = np.arange(table.layout.size)
    of_readings, f = angles_of(table.layout, cells), readings_of(table, cells)[0]
    use = table.layout.readable() & np.isfinite(f).all(axis=1)
    of_readings, f = of_readings[use], f[use]
    distance, near = _nearest(table, of_readings, angles)
    same = (distance <= EXACT)[..., None]
    mean = np.sum(np.where(same, f[near], 0.0), axis=1) / np.maximum(same.sum(axis=1), 1)
    exact = same[:, 0]
    around = np.maximum(f[near].max(axis=1), value) - np.minimum(f[near].min(axis=1), value)
    value = np.where(exact, mean, value)
    error, around = (np.where(exact, 0.0, a) for a in (error, around))
    return value, error, around, distance[:, 0]


def change_across_gaps(angles: np.ndarray, f: np.ndarray, other: Table, isotropic: bool) -> np.ndarray:
    """By how much readings f (n, C) at angles (n, 4) differ from those as near as the nearest of another table.

    In 1/sr, (n, C): a lobe that these readings show may lie between those of the other table.
    """
    from scipy.spatial import KDTree

    of_other = angles_of(other.layout, other.some_valid_cells(MOST_READINGS))
    isotropic |= _isotropic(other)
    mirrored = isotropic and (one_sided(angles) or one_sided(of_other))
    here, there = (pair_points(a, isotropic, mirrored) for a in (angles, of_other))
    gap, tree, change = np.asarray(KDTree(there, LEAF).query(here)[0]), KDTree(here, LEAF), np.empty(f.shape)
    for start in range(0, len(f), TOGETHER):
        part = slice(start, start + TOGETHER)
        near = tree.query_ball_point(here[part], np.minimum(ACROSS * gap[part], FARTHEST) + EXACT)
        number, ends = np.concatenate([np.asarray(n, int) for n in near]), np.cumsum([0, *map(len, near)])[:-1]
        change[part] = np.fmax.reduceat(f[number], ends) - np.fmin.reduceat(f[number], ends)
    return np.nan_to_num(change)


def _nearest(table: Table, readings: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances and numbers (n, k) of the readings (m, 4) of a list that are nearest to angles (n, 4)."""
    from scipy.spatial import KDTree

    isotropic = isotropic_light(table)
    mirrored = isotropic and one_sided(readings)
    here, there = (pair_points(a, isotropic, mirrored) for a in (readings, angles))
    count = min(NEIGHBOURS, len(readings))
    distance, near = KDTree(here, LEAF).query(there, count)
    return np.asarray(distance).reshape(-1, count), np.asarray(near).reshape(-1, count)


def _isotropic(table: Table) -> bool:
    return not table.layout.has_azimuth_of_light if table.layout.gridded else isotropic_light(table)
