"""Readings and what the exchanged directions would read if, between its readings, the table follows a model.

What is interpolated is the ratio of readings to the model, which changes far less than f does. A reciprocal model gives
both directions of a pair the same value, so the relative difference of the ratios is that of f.
"""

import dataclasses

import numpy as np

from gonio.checks.certificate import relative_difference
from gonio.checks.direction_search import directions, values
from gonio.checks.table.pairs.between_readings import between_readings
from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.equal_pairs import cells_without_partner, exchanged_pairs, squares_of
from gonio.checks.table.pairs.interpolated_pairs import INTERPOLATED, interpolated_pairs
from gonio.checks.table.pairs.pairs import Column, Pairs, joined, without_radiance_factor
from gonio.checks.table.pairs.places import pair_angles, places
from gonio.checks.table.pairs.scattered_pairs import scattered_pairs
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction

RECIPROCAL = 1e-6
"""Relative difference of a model's two values of a pair above which it is not reciprocal."""
DARKEST = 1e-12
"""Of the model's largest f: the ratio to less is not taken."""
MOST_VALUES = 1 << 26
"""Of a table whose ratio to a model is held."""


def assisted_pairs(table: Table, brdf: AbstractBRDF) -> Pairs | str:
    """Measured pairs, and readings beside the ratio to a model at the exchanged directions; or why there are none."""
    if table.interpolant is not None:
        return "the table brings its own interpolation between the readings"
    if table.layout.size * len(table.channels) > MOST_VALUES:
        return "the table is too large to be held beside a model"
    ratio = _over_model(table, brdf)
    if isinstance(ratio, str):
        return ratio
    measured = exchanged_pairs(table) if table.layout.gridded else scattered_pairs(table)
    if isinstance(measured, str):
        return measured
    cells = _unpaired(table, measured)
    between = interpolated_pairs(ratio, cells) if table.layout.gridded else _between_lists(ratio, cells)
    wi, wo = (directions(between.angles[:, k], between.angles[:, k + 1]) for k in (0, 2))
    model = values(brdf, wi, wo)

    def in_f(channel: int, column: Column) -> Column:
        m = model[:, channel % model.shape[1]]
        return column._replace(a=column.a * m, b=column.b * m, u_a=column.u_a * m, u_b=column.u_b * m)

    pairs = joined(without_radiance_factor(measured, table.media), between.changed(in_f))
    return dataclasses.replace(pairs, merged=measured.merged)


def _unpaired(table: Table, measured: Pairs) -> np.ndarray:
    """Cells in squares of polar angles in which nothing exchanged was read."""
    layout = table.layout
    cells = cells_without_partner(table) if layout.gridded else np.flatnonzero(layout.readable())
    return cells[~np.isin(squares_of(layout, cells), places(measured.angles).square)] if cells.size else cells


def _over_model(table: Table, brdf: AbstractBRDF) -> Table | str:
    """The table of ratios of readings to a model; or why it cannot be made."""
    wi, wo = table.layout.directions_at(np.arange(table.layout.size))
    up = table.layout.are_readable(wi.z, wo.z)
    wi, wo = (Direction(*(c[up] for c in w)) for w in (wi, wo))
    model, exchanged = values(brdf, wi, wo), values(brdf, wo, wi)
    index = np.broadcast_to(np.asarray(brdf.index_behind, float), len(table.channels))
    light, detector = (np.where(np.asarray(w.z)[:, None] > 0, 1.0, index) ** 2 for w in (wi, wo))
    if np.max(relative_difference(model / detector, exchanged / light)) > RECIPROCAL:
        return "the model is not reciprocal"
    m = np.full((table.layout.size, len(table.channels)), np.nan)
    m[up] = np.where(model > DARKEST * np.max(model, axis=0), model, np.nan)
    m = m.reshape(table.shape)
    f, u_f, flag = (None if a is None else np.asarray(a[...]) for a in (table.f, table.u_f, table.flag))
    assert f is not None and flag is not None
    flag = np.where((flag == Flag.VALID) & ~np.isfinite(m), Flag.INVALID, flag).astype(flag.dtype)
    m = np.where(np.isfinite(m), m, 1.0)
    return dataclasses.replace(table, f=f / m, u_f=None if u_f is None else u_f / m, flag=flag)


def _between_lists(ratio: Table, cells: np.ndarray) -> Pairs:
    """Readings of a list beside the interpolated ratio at the exchanged directions, where these are inside of it."""
    if cells.size > INTERPOLATED:
        cells = np.sort(np.random.default_rng(0).choice(cells, INTERPOLATED, replace=False))
    wi, wo = ratio.layout.directions_at(cells)
    f, u = readings_of(ratio, cells)
    there = between_readings(ratio, wo, wi)
    # A value that comes from the reading itself, or from beside it, says nothing.
    apart = np.abs(np.arccos(np.clip(wi.z, -1, 1)) - np.arccos(np.clip(wo.z, -1, 1)))
    value = np.where((np.sqrt(2) * apart > 2 * there.gap)[:, None], there.value, np.nan)
    around = 2 * there.around / np.maximum(np.abs(f) + np.abs(value), 1e-300)
    how = "readings whose partners were interpolated"
    return Pairs.of_arrays((f, value, u, u), pair_angles(wi, wo), cells.size, how, there.error, around=around)
