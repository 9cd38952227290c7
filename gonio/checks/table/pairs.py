"""Readings of a table that should be equal: of the exchanged pair, of the mirror image, turned, and at the pole."""

import dataclasses
from collections.abc import Callable

import numpy as np

from gonio.data.flags import Flag
from gonio.data.layouts import Layout, spherical_angles
from gonio.data.table import Table
from gonio.models.geometry.directions import Direction

THETA_MAX = np.radians(70.0)
"""Readings at polar angles beyond are not compared."""

FEWEST = 12
"""Pairs below which a median says nothing."""


MOST_CELLS = 2_000_000
"""Of a larger table so many cells are chosen at random."""

TURN = np.pi / 2
"""A brushed surface is the same after half a turn: a quarter shows most."""


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
    """Cells that should have a partner, with one or without."""
    how: str = "measured pairs"
    """How the partners came about, in words."""
    error: float = 0.0
    """Relative error of the values b that interpolation makes."""


def readings_of(table: Table, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(f, u_f) of cells in any order, each (n, channels), float64; f is NaN where it is not valid."""
    values = table.values_at(cells)
    return np.where(values["flag"] == Flag.VALID, values["f"].astype(float), np.nan), values["u_f"].astype(float)


def angles_of(layout: Layout, cells: np.ndarray) -> np.ndarray:
    """theta_i, phi_i, theta_o, phi_o, radians, of some cells: shape (n, 4)."""
    return pair_angles(*layout.directions_at(cells))


def pair_angles(wi: Direction, wo: Direction) -> np.ndarray:
    """theta_i, phi_i, theta_o, phi_o, radians, of pairs of directions: shape (n, 4)."""
    return np.stack([*spherical_angles(*wi), *spherical_angles(*wo)], axis=-1)


def _pairs(table: Table, cells: np.ndarray, partner: np.ndarray, eligible: int, how: str = "measured pairs") -> Pairs:
    (a, u_a), (b, u_b) = readings_of(table, cells), readings_of(table, partner)
    return Pairs(a, b, u_a, u_b, angles_of(table.layout, cells), eligible, how)


def _pairs_once(table: Table, partner_of: Callable[[np.ndarray], np.ndarray | None], how: str) -> Pairs:
    """The readings whose polar angles are below `THETA_MAX`, each with its partner; a pair counts once."""
    cells = np.arange(table.layout.size)
    if cells.size > MOST_CELLS:
        cells = np.sort(np.random.default_rng(0).choice(cells.size, MOST_CELLS, replace=False))
    wi, wo = table.layout.directions_at(cells)
    cells = cells[np.minimum(wi.z, wo.z) > np.cos(THETA_MAX)]
    partner = partner_of(cells)
    assert partner is not None
    # A cell that is its own partner says nothing.
    use = (partner >= 0) & (partner > cells)
    return _pairs(table, cells[use], partner[use], int(np.count_nonzero(partner != cells)), how)


def exchanged_pairs(table: Table) -> Pairs | str:
    """Readings of a grid with those of the exchanged directions; or why the layout cannot show a difference."""
    layout = table.layout
    if layout.reciprocal_by_construction:
        return "the layout stores one value for phi_d and phi_d + 180°"
    how = "measured pairs"
    if layout.mirrored_axes:
        how += ", taking the surface as mirror symmetric, as azimuth differences stop at 180°"
    if layout.one_light_azimuth:
        how += ", taking the surface as isotropic, as the light has one azimuth"
    return _pairs_once(table, layout.exchanged, how)


def mirrored_pairs(table: Table) -> Pairs | str:
    """Readings with those of both directions mirrored at a plane through the normal; or why there are none."""
    if table.layout.mirror_map() is None:
        return "no readings on both sides of a plane"
    pairs = _pairs_once(table, table.layout.mirrored, "measured pairs")
    return pairs if len(pairs.a) >= FEWEST else "the grid has no mirrored nodes"


def turned_pairs(table: Table) -> Pairs | str:
    """Readings with those of both directions turned by about a quarter; or why there are none."""
    layout = table.layout
    if not layout.turning_axes or any(a not in layout.axes or layout.axes[a].size < 4 for a in layout.turning_axes):
        return "the light has one azimuth only"
    cells, name = np.arange(layout.size), layout.turning_axes[0]
    # Of four turns two pairs are made, so that no reading is in two.
    azimuth = layout.axes[name][np.unravel_index(cells, layout.shape)[layout.dims.index(name)]]
    even = np.floor((azimuth - layout.axes[name][0]) / TURN + 1e-9) % 2 == 0
    return _comparable(table, cells[even], layout.turned(cells, TURN)[even])


def pole_pairs(table: Table) -> Pairs | str:
    """Readings at the normal with those half of the azimuths further on; or why there are none."""
    layout = table.layout
    number = np.arange(layout.size).reshape(layout.shape)
    cells, partners = [], []
    for polar, azimuth in layout.pole_axes:
        half = layout.axes[azimuth].size // 2
        if layout.axes[polar][0] <= 1e-9 and half:
            # The normal of both directions is one reading many times.
            poles = np.moveaxis(number, [layout.dims.index(a) for a in (polar, azimuth)], (0, 1))[0]
            cells.append(poles[:half].ravel())
            partners.append(poles[half : 2 * half].ravel())
    if not cells:
        return "no readings at several azimuths of the normal"
    chosen, once = np.unique(np.concatenate(cells), return_index=True)
    return _comparable(table, chosen, np.concatenate(partners)[once])


def _comparable(table: Table, cells: np.ndarray, partner: np.ndarray) -> Pairs | str:
    wi, wo = table.layout.directions_at(cells)
    use = (partner >= 0) & (partner != cells) & (np.minimum(wi.z, wo.z) > np.cos(THETA_MAX))
    if np.count_nonzero(use) < FEWEST:
        return "too few readings of the grid can be compared"
    return _pairs(table, cells[use], partner[use], int(np.count_nonzero(use)))
