"""Readings of a gridded table that should be equal: of the exchanged pair, of the mirror image, turned, at the pole."""

import dataclasses
import functools
from collections.abc import Callable, Iterator

import numpy as np

from gonio.checks.table.pairs.columns import ReadingColumns
from gonio.checks.table.pairs.pairs import FEWEST, Column, Pairs
from gonio.checks.table.pairs.places import BLOCK, SAME_POLAR, angles_of, places
from gonio.data.layouts import Layout
from gonio.data.table import COPIED, Table

MOST_CELLS = 2_000_000
"""Of a larger table so many cells are chosen at random."""
MOST_READINGS = 1 << 27
"""The same of readings: of cells with many channels fewer."""
NOT_IN_LISTS = "in a list of readings {} directions are not looked for"
TURNED = 3 / 8 * np.pi
"""Turn, radians, by which partners are apart, or the next smaller one of a grid: a surface that is the same after a
half turn, as a brushed one, a third or a quarter of one, as a woven one, shows itself by it."""
LOOKED_AT = 512
"""Cells by which a turn is chosen."""

Partner = Callable[[np.ndarray], np.ndarray | None]
"""Makes, of cells, the cells of which the readings should be the same; −1 where there is none."""


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


def cells_without_partner(table: Table) -> np.ndarray:
    """Cells above the horizon whose exchanged directions no cell has; of a large table some, at random."""
    return np.concatenate([cells[partner < 0] for cells, partner in _related(table, table.layout.exchanged)])


def squares_of(layout: Layout, cells: np.ndarray) -> np.ndarray:
    """Numbers of the squares of polar angles, (n,), of some cells."""
    parts = [cells[k : k + BLOCK] for k in range(0, max(cells.size, 1), BLOCK)]
    return np.concatenate([places(angles_of(layout, part)).square for part in parts])


def mirrored_pairs(table: Table) -> Pairs | str:
    """Readings with those of both directions mirrored at a plane through the normal; or why there are none."""
    if table.layout.mirror_map() is None:
        return "no readings on both sides of a plane" if table.layout.gridded else NOT_IN_LISTS.format("mirrored")
    pairs = _pairs_once(table, table.layout.mirrored, "measured")
    return dataclasses.replace(pairs, exchanged=False) if len(pairs) >= FEWEST else "the grid has no mirrored nodes"


def turned_pairs(table: Table) -> Pairs | str:
    """Readings with those of both directions turned by `TURNED` or about as much; or why there are none."""
    layout = table.layout
    if not layout.turning_axes or any(a not in layout.axes or layout.axes[a].size < 4 for a in layout.turning_axes):
        one = layout.gridded or np.unique(layout.axes["phi_i"]).size < 2
        return "the light has one azimuth only" if one else NOT_IN_LISTS.format("turned")
    name = layout.turning_axes[0]
    turn = _turn(layout, layout.axes[name])
    # The azimuths of one turn are partners of the next, so that no reading is in two pairs.
    past = layout.axes[name] - layout.axes[name][0]
    even = (np.floor(past / turn + 1e-9) % 2 == 0) & (past + turn < 2 * np.pi - 1e-9)

    def partner(cells: np.ndarray) -> np.ndarray:
        node = np.unravel_index(cells, layout.shape)[layout.dims.index(name)]
        return np.where(even[node], layout.turned(cells, turn), -1)

    return _comparable(table, _related(table, partner))


def _turn(layout: Layout, azimuths: np.ndarray) -> float:
    """The turn by which most readings have a partner; of several the largest up to `TURNED`, else the next larger."""
    turns = azimuths[1:] - azimuths[0]
    turns = turns[turns < np.pi - 1e-9]
    if not turns.size:
        return np.pi / 2
    cells = some_of(layout.size, LOOKED_AT) if layout.size > LOOKED_AT else np.arange(layout.size)
    shares = np.array([np.mean(layout.turned(cells, float(turn)) >= 0) for turn in turns])
    rank = np.where(turns <= TURNED + 1e-9, TURNED - turns, turns)
    return float(turns[np.lexsort((rank, shares < 0.9 * shares.max()))[0]])


def pole_pairs(table: Table) -> Pairs | str:
    """Readings at the normal with those half of the azimuths further on, which are of one geometry; or why none."""
    layout = table.layout
    if table.provenance.get(COPIED):
        return "one reading of the normal stands for all azimuths"
    steps = dict(zip(layout.dims, np.cumprod([1, *layout.shape[:0:-1]])[::-1], strict=True))
    cells, partners = [], []
    for polar, azimuth in layout.pole_axes:
        # At normal incidence a difference of azimuths is the detector's azimuth: f is the same on isotropic surfaces.
        if polar == "theta_i" and azimuth != "phi_i":
            continue
        half = layout.axes[azimuth].size // 2
        for node in layout.pole_nodes(polar) if half else []:
            # The normal of both directions is one reading many times.
            nodes = {name: np.arange(size) for name, size in zip(layout.dims, layout.shape, strict=True)}
            nodes |= {polar: np.array([node]), azimuth: np.arange(half)}
            poles = functools.reduce(np.add.outer, [nodes[name] * step for name, step in steps.items()]).ravel()
            cells.append(poles)
            partners.append(poles + half * steps[azimuth])
    if not cells:
        return "no readings at several azimuths of the normal" if layout.gridded else NOT_IN_LISTS.format("equal")
    chosen, once = np.unique(np.concatenate(cells), return_index=True)
    partner = np.concatenate(partners)[once]
    if chosen.size > _most(table):
        some = some_of(chosen.size, _most(table))
        chosen, partner = chosen[some], partner[some]
    parts = [slice(k, k + BLOCK) for k in range(0, chosen.size, BLOCK)]
    return _comparable(table, ((chosen[k], partner[k]) for k in parts))


def some_of(size: int, most: int) -> np.ndarray:
    """Of `size` numbers so many, chosen at random, in order; in memory for these alone."""
    rng, some = np.random.default_rng(0), np.zeros(0, np.int64)
    while some.size < most:
        some = _different(np.concatenate([some, rng.integers(0, size, most - some.size + most // 16)]))
    return some if some.size == most else np.sort(rng.choice(some, most, replace=False))


def _different(numbers: np.ndarray) -> np.ndarray:
    """Each of the numbers once, in order; `np.unique` looks up one after the other, and takes eight times as long."""
    numbers.sort()
    return numbers[np.diff(numbers, prepend=numbers[:1] - 1) != 0]


def _most(table: Table) -> int:
    return min(MOST_CELLS, max(MOST_READINGS // len(table.channels), 1))


def _related(table: Table, partner_of: Partner) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Cells that can be read, or some of them, with their partners; block by block."""
    size, most = table.layout.size, _most(table)
    chosen = None if size <= most else some_of(size, most)
    for start in range(0, size if chosen is None else most, BLOCK):
        cells = np.arange(start, min(start + BLOCK, size)) if chosen is None else chosen[start : start + BLOCK]
        wi, wo = table.layout.directions_at(cells)
        cells = cells[table.layout.are_readable(wi.z, wo.z)]
        partner = partner_of(cells)
        assert partner is not None
        yield cells, partner


def _pairs_once(table: Table, partner_of: Partner, how: str) -> Pairs:
    """The readings above the horizon, each with its partner; a pair counts once."""
    cells, partners, eligible = [], [], 0
    for some, partner in _related(table, partner_of):
        # A cell that is its own partner says nothing.
        use = partner > some
        eligible += int(np.count_nonzero(partner != some))
        cells.append(some[use])
        partners.append(partner[use])
    return pairs_of_cells(table, np.concatenate(cells), np.concatenate(partners), eligible, how)


def _comparable(table: Table, related: Iterator[tuple[np.ndarray, np.ndarray]]) -> Pairs | str:
    cells, partners = [], []
    for some, partner in related:
        wi, wo = table.layout.directions_at(some)
        use = (partner >= 0) & (partner != some) & table.layout.are_readable(wi.z, wo.z)
        cells.append(some[use])
        partners.append(partner[use])
    chosen = np.concatenate(cells)
    if chosen.size < FEWEST:
        return "too few readings of the grid can be compared"
    return dataclasses.replace(pairs_of_cells(table, chosen, np.concatenate(partners), chosen.size), exchanged=False)


def pairs_of_cells(table: Table, cells: np.ndarray, partner: np.ndarray, eligible: int, how: str = "measured") -> Pairs:
    """The readings of some cells with those of their partners, (n,) each."""
    size, layout = table.layout.size, table.layout
    read = None if size <= 4 * cells.size else _different(np.concatenate([cells, partner]))
    columns = ReadingColumns(table, read)
    ends = [(number if read is None else np.searchsorted(read, number)).astype(np.int32) for number in (cells, partner)]
    parts = [cells[k : k + BLOCK] for k in range(0, max(cells.size, 1), BLOCK)]
    angles = np.concatenate([angles_of(layout, part) for part in parts])

    def column(channel: int) -> Column:
        f, u = columns.of_channel(channel)
        return Column(f[ends[0]], f[ends[1]], u[ends[0]], u[ends[1]])

    if size > _most(table):
        how += f", of {_most(table):,} of {size:,} cells, chosen at random"
    return Pairs(len(table.channels), angles, eligible, column, how, cells=cells)
