"""Cells of a table that physics says are equal: the reciprocal one, and the mirror image."""

import dataclasses
from collections.abc import Callable

import numpy as np

from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.table import Table

MOST_CELLS = 2_000_000
"""Cells of a larger table are drawn at random."""


@dataclasses.dataclass(frozen=True)
class Pairs:
    """Readings a and b, (n, channels), NaN where not valid, that should be equal; their uncertainties and places."""

    a: np.ndarray
    b: np.ndarray
    u_a: np.ndarray
    u_b: np.ndarray
    angles: np.ndarray
    """(n, 4): theta_i, phi_i, theta_o, phi_o of a, radians."""
    eligible: int
    """Cells that were asked for, with a partner or without."""


def gathered(table: Table, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(f, u_f) of cells in any order, each (n, channels), float64; f is NaN where it is not valid."""
    order = np.argsort(cells, kind="stable")
    wanted = cells[order]
    f, u = (np.full((cells.size, len(table.channels)), np.nan) for _ in range(2))
    for start, stop in table.blocks():
        first, last = np.searchsorted(wanted, (start, stop))
        if first == last:
            continue
        block = table.read(start, stop)
        at, here = wanted[first:last] - start, order[first:last]
        f[here] = np.where(block.flag[at] == Flag.VALID, block.f[at], np.nan)
        u[here] = block.u_f[at]
    return f, u


def paired(table: Table, partner_of: Callable[[np.ndarray], np.ndarray | None], theta_max: float) -> Pairs:
    """The readings of a gridded table whose polar angles are below `theta_max`, each with its partner."""
    layout = table.layout
    cells = np.arange(layout.size)
    if cells.size > MOST_CELLS:
        cells = np.sort(np.random.default_rng(0).choice(cells.size, MOST_CELLS, replace=False))
    cells = cells[_inside(layout, cells, theta_max)]
    partner = partner_of(cells)
    if partner is None:
        raise ValueError("the layout relates no cells so")
    # A cell that is its own partner says nothing; a pair counts once.
    use = (partner >= 0) & (partner > cells)
    eligible = int(np.count_nonzero(partner != cells))
    cells, partner = cells[use], partner[use]
    (a, u_a), (b, u_b) = gathered(table, cells), gathered(table, partner)
    return Pairs(a, b, u_a, u_b, angles_of(layout, cells), eligible)


def angles_of(layout: Layout, cells: np.ndarray) -> np.ndarray:
    """theta_i, phi_i, theta_o, phi_o, radians, of some cells: shape (n, 4)."""
    from gonio.data.layouts import spherical_angles

    wi, wo = layout.directions_at(cells)
    return np.stack([*spherical_angles(*wi), *spherical_angles(*wo)], axis=-1)


def _inside(layout, cells, theta_max):
    wi, wo = layout.directions_at(cells)
    return np.minimum(wi.z, wo.z) > np.cos(theta_max)
