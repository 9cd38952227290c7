"""The directional albedos of a table as linear functions of its readings: one sparse row for each incidence."""

import numpy as np
from scipy import sparse

from gonio.checks.table import albedo_half_difference as half_energy
from gonio.checks.table import albedo_on_grid as grid_energy
from gonio.data.flags import Flag
from gonio.data.table import Table


def albedo_rows(table: Table, channel: int) -> sparse.csr_matrix:
    """(incidences, cells): times the readings of a channel, the albedos that `gonio check` integrates.

    No rows where the layout has no albedo (readings in a plane) or the grid does not cover the hemisphere.
    """
    valid = np.asarray(table.flag[..., channel]) == Flag.VALID
    if table.layout.outgoing_grid() is not None:
        rows = _grid_rows(table, valid)
    elif table.layout.in_half_vectors:
        rows = _half_rows(table, valid)
    else:
        rows = []
    if not rows:
        return sparse.csr_matrix((0, table.layout.size))
    at = np.concatenate([np.full(cells.size, k) for k, (cells, _) in enumerate(rows)])
    cells, weights = (np.concatenate([r[j] for r in rows]) for j in (0, 1))
    return sparse.csr_matrix((weights, (at, cells)), shape=(len(rows), table.layout.size))


def _grid_rows(table, valid):
    grid = grid_energy.hemisphere_grid(table.layout)
    if isinstance(grid, str):
        return []
    weight = grid_energy.weights_of(grid)[..., 0]
    cells = np.arange(table.layout.size).reshape(-1, *grid.inner)
    flags = valid.reshape(cells.shape)
    found = []
    for *_, k in grid.incidences:
        at, ok = (a[k][grid.rows][:, grid.source] for a in (cells, flags))
        if np.sum(weight * ~ok) <= grid_energy.MOST_MISSING * np.pi:
            found.append((grid_energy.filled(at[..., None], ok[..., None]).ravel(), weight.ravel()))
    return found


def _half_rows(table, valid):
    axes, period = table.layout.axes, table.layout.periods["phi_d"]
    if half_energy.why_not(table):
        return []
    found = []
    for theta_i, phi_i in half_energy.incidences(axes):
        weight, corners = half_energy.corners(axes, period, theta_i, phi_i)
        have = sum(w * valid[at] for at, w in corners)
        scale = np.where(have > 1e-12, weight / np.maximum(have, 1e-12), 0.0)
        cells = np.arange(valid.size).reshape(valid.shape)
        parts = [(cells[at], scale * w * valid[at]) for at, w in corners]
        parts = [(c[s > 0], s[s > 0]) for c, s in parts]
        found.append(tuple(np.concatenate([p[j] for p in parts]) for j in (0, 1)))
    return found
