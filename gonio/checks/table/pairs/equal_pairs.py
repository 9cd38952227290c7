"""Readings of a table that should be equal: of the exchanged pair, of the mirror image, turned, and at the pole."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.layouts import Layout, spherical_angles
from gonio.data.table import COPIED, Table
from gonio.models.geometry.directions import Direction

FEWEST = 12
"""Pairs below which a region is not judged alone, nor a table at all."""

MOST_CELLS = 2_000_000
"""Of a larger table so many cells are chosen at random."""

TURN = np.pi / 2
"""A brushed surface is the same after half a turn: a quarter shows most."""

BAND, SECTOR = 10.0, 30.0
"""Size of a region of pairs, degrees: of both polar angles, and of the azimuth difference."""

SIDE = int(180 // BAND)
ROUNDING = 1e-12
"""Of the largest reading: what is smaller is nothing, as where no light is refracted to."""
SAME_POLAR = 1e-6
"""Difference, radians, of polar angles that are one."""


class Place(NamedTuple):
    """Numbers of the regions of pairs, (n,) each, from the finest to the coarsest; and the square of polar angles."""

    sector: np.ndarray
    square: np.ndarray
    band: np.ndarray


def bands(angles: np.ndarray) -> np.ndarray:
    """The bands of both polar angles of pairs of directions, (n, 4) radians, the lower first: (n, 2)."""
    polar = angles[:, [0, 2]]
    number = (np.degrees(polar) / BAND + 1e-9).astype(int)
    return np.sort(np.minimum(number, np.where(polar < np.pi / 2, SIDE // 2, SIDE) - 1), axis=1)


def places(angles: np.ndarray) -> Place:
    """The regions of pairs of directions, (n, 4) radians; the same for an exchanged pair."""
    low, high = bands(angles).T
    turn = np.abs(np.mod(angles[:, 3] - angles[:, 1] + np.pi, 2 * np.pi) - np.pi)
    square = high * SIDE + low
    return Place(square * 100 + (np.degrees(turn) / SECTOR - 1e-9).astype(int), square, high)


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
    how: str = "measured"
    """How the partners came about, in words."""
    error: np.ndarray | float = 0.0
    """Relative error of the values b that interpolation makes, (n, channels) or one for all."""
    merged: np.ndarray | None = None
    """(m, 4), radians: all readings once their repeats are merged, where there may be repeats."""
    exchanged: bool = True
    """Whether b is of the exchanged directions, so that its light comes from where a has the detector."""

    @property
    def theta_i(self) -> tuple[np.ndarray, np.ndarray]:
        """Polar angles of incidence of a and of b, (n,) radians each."""
        return self.angles[:, 0], self.angles[:, 2 if self.exchanged else 0]

    @property
    def theta_o(self) -> tuple[np.ndarray, np.ndarray]:
        """Polar angles of the detector of a and of b, (n,) radians each."""
        return self.angles[:, 2], self.angles[:, 0 if self.exchanged else 2]

    def where(self, some: np.ndarray) -> "Pairs":
        """Some of the pairs; all of them have the same error."""
        fields = {name: getattr(self, name)[some] for name in ("a", "b", "u_a", "u_b", "angles")}
        return dataclasses.replace(self, **fields)


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


def _pairs(table: Table, cells: np.ndarray, partner: np.ndarray, eligible: int, how: str = "measured") -> Pairs:
    (a, u_a), (b, u_b) = readings_of(table, cells), readings_of(table, partner)
    return Pairs(a, b, u_a, u_b, angles_of(table.layout, cells), eligible, how)


def _pairs_once(table: Table, partner_of: Callable[[np.ndarray], np.ndarray | None], how: str) -> Pairs:
    """The readings above the horizon, each with its partner; a pair counts once."""
    cells = np.arange(table.layout.size)
    if cells.size > MOST_CELLS:
        cells = np.sort(np.random.default_rng(0).choice(cells.size, MOST_CELLS, replace=False))
    wi, wo = table.layout.directions_at(cells)
    cells = cells[table.layout.are_readable(wi.z, wo.z)]
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
    how = "measured"
    if layout.mirrored_axes:
        how += ", taking the surface as mirror symmetric, as azimuth differences stop at 180°"
    if layout.one_light_azimuth:
        how += ", taking the surface as isotropic, as the light has one azimuth"
    pairs = _pairs_once(table, layout.exchanged, how)
    if layout.has_azimuth_of_light:
        return pairs
    # On an isotropic surface readings of θo = θi are exchanged by mirroring them: they say nothing of reciprocity.
    return pairs.where(np.abs(pairs.angles[:, 0] - pairs.angles[:, 2]) > SAME_POLAR)


def without_radiance_factor(pairs: Pairs, media: tuple[np.ndarray, np.ndarray]) -> Pairs:
    """Exchanged pairs, those through the sample divided by the squared index of the detector's medium.

    f_t(i → o)/n_o² = f_t(o → i)/n_i² [Walter 2007]; `media` are the indices (C,) in front of the sample and behind it.
    """
    behind = [np.cos(pairs.angles[:, k, None]) < 0 for k in (0, 2)]
    through = behind[0] != behind[1]
    by_light, by_detector = (np.where(through, np.where(b, media[1], media[0]) ** 2, 1.0) for b in behind)
    a, b = pairs.a / by_detector, pairs.b / by_light
    size = np.fmax(np.abs(a), np.abs(b))
    nothing = size <= ROUNDING * np.nanmax(size, initial=0.0)
    a, b = (np.where(nothing, 0.0, v) for v in (a, b))
    return dataclasses.replace(pairs, a=a, b=b, u_a=pairs.u_a / by_detector, u_b=pairs.u_b / by_light)


def cells_without_partner(table: Table) -> np.ndarray:
    """Cells above the horizon whose exchanged directions no cell has; of a large table some, at random."""
    cells = np.arange(table.layout.size)
    if cells.size > MOST_CELLS:
        cells = np.sort(np.random.default_rng(0).choice(cells.size, MOST_CELLS, replace=False))
    partner, (wi, wo) = table.layout.exchanged(cells), table.layout.directions_at(cells)
    assert partner is not None
    return cells[(partner < 0) & (table.layout.are_readable(wi.z, wo.z))]


def joined(first: Pairs, second: Pairs) -> Pairs:
    """Both kinds of pairs of one table."""
    if not len(first.a) or not len(second.a):
        return second if len(second.a) else first
    error = [np.broadcast_to(np.asarray(p.error, float), p.a.shape) for p in (first, second)]
    fields = ("a", "b", "u_a", "u_b", "angles")
    both: dict[str, Any] = {name: np.concatenate([getattr(p, name) for p in (first, second)]) for name in fields}
    how = f"{first.how} and {len(second.a):,} {second.how}"
    return Pairs(**both, eligible=max(first.eligible, second.eligible), how=how, error=np.concatenate(error))


def mirrored_pairs(table: Table) -> Pairs | str:
    """Readings with those of both directions mirrored at a plane through the normal; or why there are none."""
    if table.layout.mirror_map() is None:
        return "no readings on both sides of a plane"
    pairs = _pairs_once(table, table.layout.mirrored, "measured")
    return dataclasses.replace(pairs, exchanged=False) if len(pairs.a) >= FEWEST else "the grid has no mirrored nodes"


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
    if table.provenance.get(COPIED):
        return "one reading of the normal stands for all azimuths"
    number = np.arange(layout.size).reshape(layout.shape)
    cells, partners = [], []
    for polar, azimuth in layout.pole_axes:
        half = layout.axes[azimuth].size // 2
        for node in layout.pole_nodes(polar) if half else []:
            # The normal of both directions is one reading many times.
            poles = np.moveaxis(number, [layout.dims.index(a) for a in (polar, azimuth)], (0, 1))[node]
            cells.append(poles[:half].ravel())
            partners.append(poles[half : 2 * half].ravel())
    if not cells:
        return "no readings at several azimuths of the normal"
    chosen, once = np.unique(np.concatenate(cells), return_index=True)
    return _comparable(table, chosen, np.concatenate(partners)[once])


def _comparable(table: Table, cells: np.ndarray, partner: np.ndarray) -> Pairs | str:
    wi, wo = table.layout.directions_at(cells)
    use = (partner >= 0) & (partner != cells) & (table.layout.are_readable(wi.z, wo.z))
    if np.count_nonzero(use) < FEWEST:
        return "too few readings of the grid can be compared"
    pairs = _pairs(table, cells[use], partner[use], int(np.count_nonzero(use)))
    return dataclasses.replace(pairs, exchanged=False)
