"""By how much a list's readings differ from the nearest ones of other directions."""

from collections.abc import Iterator

import numpy as np

from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.next_nodes import Change
from gonio.checks.table.pairs.pair_points import EXACT, LEAF, isotropic_light, one_sided, pair_points
from gonio.checks.table.pairs.places import angles_of
from gonio.data.table import Table

NEAREST = 8
"""Readings of other directions, about two for each of the angles."""


def changes_to_nearest_readings(table: Table, angles: np.ndarray) -> Iterator[Change]:
    """The changes from the readings at angles (n, 4) of a list, radians, to one more of their nearest neighbours each.

    Not a number, where one of both is not valid.
    """
    from scipy.spatial import KDTree

    cells = np.flatnonzero(table.layout.readable())
    read, f = angles_of(table.layout, cells), readings_of(table, cells)[0]
    isotropic = isotropic_light(table)
    mirrored = isotropic and one_sided(read)
    points, places = (pair_points(a, isotropic, mirrored) for a in (read, angles))
    once = np.unique(np.round(points / EXACT), axis=0, return_index=True)[1]
    points, f = points[once], f[once]
    distance, near = KDTree(points, LEAF).query(places, min(NEAREST + 1, len(points)))
    distance, near = (np.asarray(a).reshape(len(angles), -1) for a in (distance, near))
    first = f[near[:, 0]]
    for k in range(1, near.shape[1]):
        other = f[near[:, k]]
        yield Change(np.abs(other - first), np.maximum(np.abs(other), np.abs(first)), distance[:, k])
