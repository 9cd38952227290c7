"""The directional albedos of a table as linear functions of its readings: one sparse row for each incidence."""

import numpy as np
from scipy import sparse

from gonio.checks.table.albedos.half_difference import half_vector_grid
from gonio.checks.table.albedos.on_grid import filled, hemisphere_grid
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.geometry.sides import FRONT

Row = tuple[np.ndarray, np.ndarray]
"""Numbers of cells and their weights."""


def albedo_rows(table: Table, channel: int) -> sparse.csr_array:
    """(incidences, cells): times the readings of a channel, the albedos that `gonio check` integrates.

    R + T of a table of both sides of a sample. No rows where the layout has no albedo (readings in a plane) or the grid
    does not cover the hemisphere.
    """
    rows = list((_rows(table, channel) if table.sides == FRONT else _two_sided_rows(table, channel)).values())
    if not rows:
        return sparse.csr_array((0, table.layout.size))
    number = np.concatenate([np.full(cells.size, k) for k, (cells, _) in enumerate(rows)])
    cells, weights = (np.concatenate(column) for column in zip(*rows, strict=True))
    return sparse.csr_array((weights, (number, cells)), shape=(len(rows), table.layout.size))


def _rows(table: Table, channel: int) -> dict[int, Row]:
    """Those of a table of one side, by the numbers of their incidences."""
    valid = (table.read_values()["flag"][:, channel] == Flag.VALID).reshape(table.layout.shape)
    if table.layout.in_half_vectors:
        return dict(enumerate(_half_rows(table, valid)))
    return _grid_rows(table, valid)


def _two_sided_rows(table: Table, channel: int) -> dict[tuple[int, int], Row]:
    """What is reflected and what is transmitted of an incidence, by the side of the light and its number there."""
    whole, rows = np.arange(table.layout.size).reshape(table.layout.shape), {}
    for (light, detector), part in table.parts().items():
        cells = whole[table.layout.folded(light, detector)[1]].ravel()
        for number, (of_part, weights) in _rows(part, channel).items():
            before = rows.get((light, number), (np.zeros(0, int), np.zeros(0)))
            rows[light, number] = tuple(
                np.concatenate(pair) for pair in zip(before, (cells[of_part], weights), strict=True)
            )
    return rows


def _grid_rows(table: Table, valid: np.ndarray) -> dict[int, Row]:
    grid = hemisphere_grid(table.layout)
    if isinstance(grid, str):
        return {}
    rows = {}
    for number, *_ in grid.incidences:
        cells = (number * grid.stored + grid.cells)[..., None]
        ok = valid.ravel()[cells]
        if not grid.missing(ok):
            rows[number] = (filled(cells, ok).ravel(), grid.weights.ravel())
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
