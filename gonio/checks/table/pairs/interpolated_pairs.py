"""Readings of a gridded table with interpolated values of the exchanged directions, where no cell has these."""

import itertools

import numpy as np

from gonio.checks.table.pairs.between_readings import between_readings
from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.next_nodes import change_to_next_nodes
from gonio.checks.table.pairs.pairs import Pairs
from gonio.checks.table.pairs.places import SAME_POLAR, pair_angles
from gonio.data.interpolation.grid_coordinates import grid_coordinates
from gonio.data.table import Table
from gonio.models.geometry.directions import Direction

INTERPOLATED = 20_000
"""Of more readings without a partner so many are compared with interpolated ones, chosen at random."""


def _reached(nodes: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Whether angles lie among the nodes of an axis; of polar angles among those on their side of the horizon."""
    reached = np.zeros(angle.shape, bool)
    # Signed angles in a plane count from −180°: the horizon is at ±90°.
    edges = np.array([-np.pi, -np.pi / 2, np.pi / 2, np.pi])
    for low, high in itertools.pairwise(edges):
        if (there := nodes[(nodes >= low) & (nodes <= high)]).size:
            reached |= (angle >= there[0] - SAME_POLAR) & (angle <= there[-1] + SAME_POLAR)
    return reached


def interpolated_pairs(table: Table, cells: np.ndarray) -> Pairs:
    """Readings of some cells with interpolated values of the exchanged directions, where the grid reaches these.

    The error is what every second node of each axis changes: of a second-order rule on a grid that resolves f, three
    times its own. Where a grid does not resolve f that is no bound; the readings around, `Pairs.around`, are one of
    whatever is monotone between them, with the change from the reading itself to the next nodes one of peaks that the
    grid does not resolve.
    """
    if cells.size > INTERPOLATED:
        cells = np.sort(np.random.default_rng(0).choice(cells, INTERPOLATED, replace=False))
    layout = table.layout
    wi, wo = layout.directions_at(cells)
    exchanged, _ = grid_coordinates(type(layout), wo, wi)
    within = layout.are_readable(wi.z, wo.z)
    for name, nodes in layout.axes.items():
        if layout.periods[name] is None and name not in layout.mirrored_axes:
            within &= _reached(nodes, exchanged[name])
    wi, wo = (Direction(*(c[within] for c in w)) for w in (wi, wo))
    how = "readings whose partners were interpolated"
    if not within.any():
        none = np.zeros((0, len(table.channels)))
        return Pairs.of_arrays((none, none, none, none), np.zeros((0, 4)), cells.size, how)
    f, u = readings_of(table, cells[within])
    partner = between_readings(table, wo, wi)
    around = (
        (partner.around + change_to_next_nodes(table, cells[within]))
        * 2
        / np.maximum(np.abs(f) + np.abs(partner.value), 1e-300)
    )
    readings, angles = (f, partner.value, u, u), pair_angles(wi, wo)
    return Pairs.of_arrays(readings, angles, cells.size, how, partner.error, around=around, cells=cells[within])
