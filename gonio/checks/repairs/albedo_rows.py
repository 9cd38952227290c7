"""The directional albedos of a table as linear functions of its readings: one sparse row for each incidence."""

import numpy as np
from scipy import sparse

from gonio.checks.table.albedos.half_difference import half_vector_grid
from gonio.checks.table.albedos.on_grid import filled, hemisphere_grid
from gonio.data.flags import Flag
from gonio.data.table import Table

Row = tuple[np.ndarray, np.ndarray]
"""Numbers of cells and their weights."""


def albedo_rows(table: Table, channel: int) -> sparse.csr_array:
    """(incidences, cells): times the readings of a channel, the albedos that `gonio check` integrates.

    No rows where the layout has no albedo (readings in a plane) or the grid does not cover the hemisphere.
    """
    valid = (table.read_values()["flag"][:, channel] == Flag.VALID).reshape(table.layout.shape)
    rows = _half_rows(table, valid) if table.layout.in_half_vectors else _grid_rows(table, valid)
    if not rows:
        return sparse.csr_array((0, table.layout.size))
    number = np.concatenate([np.full(cells.size, k) for k, (cells, _) in enumerate(rows)])
    cells, weights = (np.concatenate(column) for column in zip(*rows, strict=True))
    return sparse.csr_array((weights, (number, cells)), shape=(len(rows), table.layout.size))


def _grid_rows(table: Table, valid: np.ndarray) -> list[Row]:
    grid = hemisphere_grid(table.layout)
    if isinstance(grid, str):
        return []
    rows = []
    for number, *_ in grid.incidences:
        cells = (number * grid.stored + grid.cells)[..., None]
        ok = valid.ravel()[cells]
        if not grid.missing(ok):
            rows.append((filled(cells, ok).ravel(), grid.weights.ravel()))
    return rows


def _half_rows(table: Table, valid: np.ndarray) -> list[Row]:
    grid = half_vector_grid(table)
    if isinstance(grid, str):
        return []
    rows, number = [], np.arange(valid.size).reshape(valid.shape)
    for theta_i, phi_i in grid.incidences():
        weight, angles = grid.half_vectors(theta_i, phi_i)
        corners = grid.corners(angles)
        have = sum(share * valid[cells] for cells, share in corners)
        scale = np.where(have > 1e-12, weight / np.maximum(have, 1e-12), 0.0)
        terms = [(number[cells].ravel(), (scale * share * valid[cells]).ravel()) for cells, share in corners]
        cells, weights = (np.concatenate(column) for column in zip(*terms, strict=True))
        rows.append((cells[weights > 0], weights[weights > 0]))
    return rows
