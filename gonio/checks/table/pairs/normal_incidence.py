"""Readings at normal incidence, which on an isotropic surface do not depend on the detector's azimuth."""

import dataclasses

import numpy as np

from gonio.checks.table.pairs.equal_pairs import pairs_of_cells
from gonio.checks.table.pairs.pairs import FEWEST, Pairs
from gonio.checks.table.pairs.places import SAME_POLAR, angles_of
from gonio.data.layouts import Layout
from gonio.data.table import COPIED, Table

TURNED = 3 / 8 * np.pi
"""Azimuth, radians, by which partners are apart, or less: a surface that is the same after a half turn, as a brushed
one, a third or a quarter of one, as a woven one, shows itself by it."""
SAME_AZIMUTH = 1e-6
"""Difference of azimuths, radians, that are one."""


def normal_incidence_pairs(table: Table) -> Pairs | str:
    """Readings at normal incidence with those of the same polar angle at another azimuth; or why there are none.

    Each reading is in one pair. Of an isotropic surface both are the same, whatever the azimuth of the light.
    """
    if table.provenance.get(COPIED):
        return "at normal incidence one reading stands for several azimuths"
    cells = _normal_incidence(table.layout)
    if not cells.size:
        return "nothing was read at normal incidence"
    theta_i, phi_i, theta_o, phi_o = angles_of(table.layout, cells).T
    tilted = np.sin(theta_o) > SAME_POLAR
    cells = cells[tilted & table.layout.are_readable(np.cos(theta_i), np.cos(theta_o))]
    theta_i, phi_i, theta_o, phi_o = angles_of(table.layout, cells).T
    azimuth = np.mod(np.round((phi_o - phi_i) / SAME_AZIMUTH) * SAME_AZIMUTH, 2 * np.pi)
    ring = np.stack([np.round(np.cos(theta_i)), np.round(theta_o / SAME_POLAR)])
    order = np.lexsort((azimuth, *ring[::-1]))
    first, partner = [], []
    for members in np.split(order, np.flatnonzero(np.diff(ring[:, order]).any(axis=0)) + 1):
        once = members[np.unique(azimuth[members], return_index=True)[1]]
        a, b = _partners(azimuth[once])
        first.append(cells[once[a]])
        partner.append(cells[once[b]])
    chosen = np.concatenate(first)
    if chosen.size < FEWEST:
        return "too few readings at normal incidence can be compared"
    pairs = pairs_of_cells(table, chosen, np.concatenate(partner), chosen.size, "measured at normal incidence")
    return dataclasses.replace(pairs, exchanged=False)


def _normal_incidence(layout: Layout) -> np.ndarray:
    """Numbers of the cells whose light comes along the normal; none where no axis has its polar angle."""
    if (theta_i := layout.axes.get("theta_i")) is None:
        return np.zeros(0, np.int64)
    nodes = np.flatnonzero(np.abs(np.sin(theta_i)) <= SAME_POLAR)
    if not layout.gridded:
        return nodes
    return (nodes[:, None] * layout.row_size + np.arange(layout.row_size)).ravel()


def _partners(azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the readings of a ring, in order of azimuth, and of those that they are compared with."""
    n = azimuth.size
    if n < 2:
        return np.zeros(0, int), np.zeros(0, int)
    step, number = max(1, int(TURNED * (n - 1) / np.ptp(azimuth) + 1e-9)), np.arange(n)
    number = number[(number // step % 2 == 0) & (number + step < n)]
    return number, number + step
