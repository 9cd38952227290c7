"""The readings of a large table where they are: what a fit looks at is taken out of it block by block, and not kept."""

import bisect
import copy
import dataclasses
import functools
import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.sides import FRONT

BLOCK = 1 << 18
"""Readings of a block, channels counted apart."""
NUMBERED = 16 << 20
"""Bytes of the used cells' numbers in their blocks that are kept; those of other blocks are unpacked from bits."""
Rows = slice | np.ndarray
"""Which rows: a range, their numbers in any order, or booleans of all."""


class Values(NamedTuple):
    """Of some rows f, 0 where there is none, its standard uncertainty, and which are valid, (n, C)."""

    f: np.ndarray
    u_f: np.ndarray
    valid: np.ndarray


@dataclasses.dataclass
class Tally:
    """Valid readings of each channel (C,), how many of all are negative, and have a known uncertainty above 0.

    `sides`: cells by the sides of light and detector, (4,): in front and in front, in front and behind, ...
    """

    valid: np.ndarray
    negative: int = 0
    known: int = 0
    sides: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(4, np.int64))

    def add(self, v: Values, pair: tuple[Direction, Direction] | None) -> None:
        """Count some readings; without directions, light and detector are in front."""
        # Channel by channel: NumPy goes along a short last axis one number at a time.
        self.valid += len(v.valid) if v.valid.all() else [np.count_nonzero(c) for c in v.valid.T]
        self.negative += int(np.count_nonzero(v.f < 0))
        if any(v.u_f.strides) or np.isfinite(v.u_f[:1]).any():
            self.known += int(np.count_nonzero(v.valid & np.isfinite(v.u_f) & (v.u_f > 0)))
        if pair is None:
            self.sides[0] += len(v.f)
        else:
            behind = [np.asarray(w.z) < 0 for w in pair]
            self.sides += np.bincount(2 * behind[0] + behind[1], minlength=4)


class _Block(NamedTuple):
    """A block of the table: its cells, which of them are used as bits (None: all), and the number of its first row."""

    start: int
    stop: int
    bits: np.ndarray | None
    first: int


class TableRows:
    """The usable cells of a table in C order, as rows: their directions and values are read where they are asked for.

    The two blocks that were read last are kept: what is looked at in turn may lie in both.
    """

    def __init__(self, table: Table, theta_max: float | None = None) -> None:
        """Of the cells that are valid in any channel, both directions nearer to a normal than `theta_max`, radians."""
        self._table, self._blocks, first = table, list[_Block](), 0
        self._channels: slice | np.ndarray = slice(None)
        self._directions, self._values = dict[int, tuple[Direction, Direction]](), dict[int, Values]()
        self._used_cells, self._numbered, self._room = dict[int, np.ndarray](), dict[int, np.ndarray](), NUMBERED
        self._lasting = dict[int, tuple[Direction, Direction]]()
        self._last_choice: tuple[np.ndarray, Values] | None = None
        self._last_places: tuple[np.ndarray, tuple[Direction, Direction]] | None = None
        self._by_flag, tally = np.zeros(256, np.int64), Tally(np.zeros(len(table.channels), np.int64))
        for k, (start, stop) in enumerate(table.blocks(BLOCK)):
            values = table.read_values(start, stop)
            valid = table.are_valid(values["flag"], start, theta_max)
            for flag in Flag:
                self._by_flag[flag] += np.count_nonzero(values["flag"] == flag)
            self._blocks.append(_Block(start, stop, None if valid.all() else np.packbits(valid), first))
            first += int(np.count_nonzero(valid))
            tally.add(self._taken(k, values), None if table.layout.sides == FRONT else self._directions_of(k))
        self.shape = (first, len(table.channels))
        self._ends = [*(b.first for b in self._blocks), first]
        self._whole = all(b.bits is None for b in self._blocks)
        vars(self)["tally"] = tally

    @property
    def flags(self) -> dict[str, int]:
        """Readings of the whole table by their flags, as `Table.counts` names them."""
        return {flag.name.lower(): int(self._by_flag[flag]) for flag in Flag}

    def of_channels(self, these: slice | np.ndarray) -> "TableRows":
        """The same rows of some of the channels."""
        other = copy.copy(self)
        other._channels = np.arange(len(self._table.channels))[self._channels][these]
        other.shape = self.shape[0], other._channels.size
        other._values, other._last_choice = {}, None
        vars(other).pop("tally", None)
        return other

    @property
    def spans(self) -> Iterator[slice]:
        """The rows of each block that has any."""
        return (slice(a, b) for a, b in itertools.pairwise(self._ends) if a < b)

    def keep_directions(self, span: slice, wi: Direction, wo: Direction) -> None:
        """Take these as the directions of a block, which somebody keeps anyway, and compute them no more."""
        k = self._parts(span)[0][0]
        self._lasting[k] = wi, wo
        self._directions.pop(k, None)

    @functools.cached_property
    def tally(self) -> Tally:
        """What there is."""
        tally, front = Tally(np.zeros(self.shape[1], np.int64)), self._table.layout.sides == FRONT
        for span in self.spans:
            tally.add(self.values(span), None if front else self.directions(span))
        return tally

    def directions(self, rows: Rows) -> tuple[Direction, Direction]:
        """(wi, wo) of some rows."""
        if not isinstance(rows, slice):
            rows = _numbers(rows)
            if self._last_places is None or not np.array_equal(self._last_places[0], rows):
                self._last_places = rows, self._table.layout.directions_at(self._cells(rows))
            return self._last_places[1]
        parts = [[c[some] for w in self._directions_of(k) for c in w] for k, some in self._parts(rows)]
        x_i, y_i, z_i, x_o, y_o, z_o = parts[0] if len(parts) == 1 else map(np.concatenate, zip(*parts, strict=True))
        return Direction(x_i, y_i, z_i), Direction(x_o, y_o, z_o)

    def values(self, rows: Rows) -> Values:
        """The values of some rows."""
        if isinstance(rows, slice):
            parts = [[a[some] for a in self._values_of(k)] for k, some in self._parts(rows)]
            return Values(*(parts[0] if len(parts) == 1 else map(np.concatenate, zip(*parts, strict=True))))
        rows = _numbers(rows)
        order = None if (rows[1:] >= rows[:-1]).all() else np.argsort(rows, kind="stable")
        rising = rows if order is None else rows[order]
        if self._last_choice is None or not np.array_equal(self._last_choice[0], rising):
            self._last_choice = rising, self._used(self._table.values_at(self._cells(rising)))
        values = self._last_choice[1]
        if order is None:
            return values
        back = np.argsort(order)
        return Values(*(rows_of(a, back) for a in values))

    def _parts(self, rows: slice) -> list[tuple[int, slice]]:
        """The blocks in which a range of rows lies, and which of a block's rows are in it; at least one."""
        first, last, _ = rows.indices(self.shape[0])
        from_block, to_block = (bisect.bisect_right(self._ends, row) - 1 for row in (first, max(first, last - 1)))
        parts = []
        for k in range(from_block, to_block + 1):
            start, stop = max(first, self._ends[k]) - self._ends[k], min(last, self._ends[k + 1]) - self._ends[k]
            if start < stop or from_block == to_block:
                parts.append((k, slice(start, max(start, stop))))
        return parts

    def _directions_of(self, k: int) -> tuple[Direction, Direction]:
        if k in self._lasting:
            return self._lasting[k]
        if k not in self._directions:
            wi, wo = self._table.layout.directions(self._blocks[k].start, self._blocks[k].stop)
            if (used := self._used_of(k)) is not None:
                wi, wo = (Direction(*(np.asarray(c)[used] for c in w)) for w in (wi, wo))
            _remember(self._directions, k, (wi, wo))
        return self._directions[k]

    def _values_of(self, k: int) -> Values:
        if k not in self._values:
            values = self._table.read_values(self._blocks[k].start, self._blocks[k].stop)
            _remember(self._values, k, self._taken(k, values))
        return self._values[k]

    def _taken(self, k: int, values: dict[str, np.ndarray]) -> Values:
        """The rows of a block of all its cells' values."""
        used = self._used_of(k)
        return self._used(values if used is None else {name: rows_of(a, used) for name, a in values.items()})

    def _used_of(self, k: int) -> np.ndarray | None:
        """Which cells of a block are used, counted from its first; None: all."""
        block = self._blocks[k]
        if block.bits is None:
            return None
        if (numbered := self._numbered.get(k)) is not None:
            return numbered
        if k not in self._used_cells:
            used = np.flatnonzero(np.unpackbits(block.bits, count=block.stop - block.start).view(bool))
            if used.size * 4 <= self._room:
                self._room -= used.size * 4
                self._numbered[k] = used.astype(np.int32)
                return used
            _remember(self._used_cells, k, used)
        return self._used_cells[k]

    def _used(self, values: dict[str, np.ndarray]) -> Values:
        f, u_f, flag = (values[name][:, self._channels] for name in ("f", "u_f", "flag"))
        valid = (flag == Flag.VALID) & np.isfinite(f)
        # Reading f where it is masked would carry a NaN into sums: the value there is never looked at again.
        f = np.asarray(f if valid.all() else np.where(valid, f, 0.0), float)
        return Values(f, np.asarray(u_f, float), valid)

    def _cells(self, rows: np.ndarray) -> np.ndarray:
        """Numbers of the table's cells that rows stand for."""
        if self._whole:
            return rows
        order = np.argsort(rows, kind="stable")
        rising, cells = rows[order], np.empty(rows.size, np.int64)
        edges = np.searchsorted(rising, self._ends)
        for k, (first, last) in enumerate(itertools.pairwise(edges)):
            if first < last:
                block, used = self._blocks[k], self._used_of(k)
                inside = rising[first:last] - block.first
                cells[order[first:last]] = np.add(inside if used is None else used[inside], block.start, dtype=np.int64)
        return cells


def rows_of(a: np.ndarray, cells: Rows) -> np.ndarray:
    """Some rows, a range, by number or as booleans, of values (n, C); a number that stands for all takes no memory."""
    if isinstance(cells, slice):
        return a[cells]
    if not any(a.strides):
        number = int(np.count_nonzero(cells)) if cells.dtype == bool else cells.size
        return np.broadcast_to(a[:1, :1], (number, a.shape[1]))
    return a[cells] if cells.dtype == bool else a.take(cells, axis=0)


def _remember(blocks: dict[int, Any], k: int, block: Any) -> None:
    """Add a block; of those before it the last one stays."""
    for other in list(blocks)[:-1]:
        del blocks[other]
    blocks[k] = block


def _numbers(rows: np.ndarray) -> np.ndarray:
    return np.flatnonzero(rows) if rows.dtype == bool else rows
