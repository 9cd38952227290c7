"""Tables larger than memory, of which only the cells are read that somebody asks for.

A scene sees some ten thousand pairs of directions: interpolation reads the corners about these, wherever they lie in
the file, in memory that does not grow with the table.
"""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.table import Table

Nodes = tuple[np.ndarray, ...]
"""Numbers of the kept nodes of each axis, increasing."""
GATHERED = 4096
"""Cells that are read of a file at a time: its pages about them are given back after each."""


@dataclasses.dataclass(frozen=True)
class StoredCells:
    """A variable of a table's file, (*layout, channels), that reads the cells of an index alone.

    `numbers`: of the channels that it shows, in this order.
    """

    dataset: Any
    numbers: tuple[int, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Of what it shows."""
        return (*self.dataset.shape[:-1], len(self.numbers))

    @property
    def dtype(self) -> np.dtype:
        """Of the values."""
        return np.dtype(self.dataset.dtype)

    def __getitem__(self, index: tuple[np.ndarray, ...]) -> np.ndarray:
        """Values (*n, channels) of the cells of an index: an array for each axis of the layout, which broadcast."""
        cells = np.ravel_multi_index(np.broadcast_arrays(*index), self.dataset.shape[:-1])
        wanted, back = np.unique(cells, return_inverse=True)
        read = self._contiguous if self.dataset.id.get_offset() is not None else self._by_rows
        values = [read(wanted[k : k + GATHERED]) for k in range(0, wanted.size, GATHERED)]
        empty = np.empty((0, len(self.numbers)), self.dtype)
        return np.concatenate([empty, *values])[back.reshape(cells.shape)]

    def only(self, numbers: Sequence[int]) -> "StoredCells":
        """The same with some of the channels that it shows."""
        return StoredCells(self.dataset, tuple(self.numbers[k] for k in numbers))

    def _contiguous(self, cells: np.ndarray) -> np.ndarray:
        channels = self.dataset.shape[-1]
        shape, offset = (int(np.prod(self.dataset.shape[:-1])), channels), self.dataset.id.get_offset()
        file = np.memmap(os.fsdecode(self.dataset.file.filename), self.dtype, "r", offset, shape)
        return np.array(file[cells])[:, list(self.numbers)]

    def _by_rows(self, cells: np.ndarray) -> np.ndarray:
        """The same of a variable that is packed, or that has no values of its own: row by row of the first axis."""
        row = int(np.prod(self.dataset.shape[1:-1]))
        values = np.empty((cells.size, len(self.numbers)), self.dtype)
        for first in np.unique(cells // row):
            here = cells // row == first
            whole = self.dataset[int(first)].reshape(row, -1)
            values[here] = whole[cells[here] - first * row][:, list(self.numbers)]
        return values


@dataclasses.dataclass(frozen=True)
class ValidCells:
    """Whether the cells of a table have a value: flagged as valid, and finite."""

    f: StoredCells
    flag: StoredCells

    @property
    def shape(self) -> tuple[int, ...]:
        """That of the values."""
        return self.f.shape

    def __getitem__(self, index: tuple[np.ndarray, ...]) -> np.ndarray:
        """Of the cells of an index, as `StoredCells` gives values."""
        return (self.flag[index] == Flag.VALID) & np.isfinite(self.f[index])


def is_stored(table: Table) -> bool:
    """Whether the cells of a table stay in its file, and are read by `StoredCells`."""
    return isinstance(table.f, StoredCells)


def with_stored_cells(table: Table) -> Table:
    """A table, so that of one too large for memory, on a grid, only those cells are read that somebody asks for."""
    if isinstance(table.f, np.ndarray) or not table.layout.gridded or table.interpolant is not None:
        return table
    every = tuple(range(len(table.channels)))
    f, flag = StoredCells(table.f, every), StoredCells(table.flag, every)
    u_f = StoredCells(table.u_f, every) if hasattr(table.u_f, "id") else table.u_f  # else one number for all
    return dataclasses.replace(table, f=f, flag=flag, u_f=u_f)


def some_channels(table: Table, names: Sequence[str]) -> Table:
    """`Table.only` of a table with stored cells too."""
    if not is_stored(table):
        return table.only(names)
    numbers, wavelengths = [table.channels.names.index(name) for name in names], table.channels.wavelengths_nm
    chosen = None if wavelengths is None else tuple(wavelengths[k] for k in numbers)
    f, flag, u_f = table.f.only(numbers), table.flag.only(numbers), table.u_f
    if u_f is not None:
        one_for_all = isinstance(u_f, np.ndarray)
        u_f = np.broadcast_to(u_f.flat[0], f.shape) if one_for_all else u_f.only(numbers)
    return dataclasses.replace(table, f=f, flag=flag, u_f=u_f, channels=Channels(tuple(names), chosen))


def coarse_table(table: Table, readings: int, error: Callable[[Nodes], float] = lambda nodes: 0.0) -> Table:
    """A table in memory of evenly chosen nodes of each axis of one with stored cells, at most so many readings.

    Every second node goes, again and again, of the axis whose loss makes the least error, of equal ones the longest;
    outermost nodes stay where an axis has ends.
    """
    layout = table.layout
    kept: Nodes = tuple(np.arange(n) for n in layout.shape)
    limit = max(readings // len(table.channels), 2 ** len(kept))
    while math.prod(k.size for k in kept) > limit:
        trials = [
            (*kept[:k], _every_second(nodes, layout.periods[name] is not None), *kept[k + 1 :])
            for k, (name, nodes) in enumerate(zip(layout.axes, kept, strict=True))
            if nodes.size > 2
        ]
        kept = min(trials, key=lambda trial: (error(trial), math.prod(k.size for k in trial)))
    index = np.ix_(*kept)
    f, flag, u_f = (None if a is None else a[index] for a in (table.f, table.flag, table.u_f))
    part = layout.part(**dict(zip(layout.axes, kept, strict=True)))
    return dataclasses.replace(table, layout=part, f=f, flag=flag, u_f=u_f)


def _every_second(nodes: np.ndarray, periodic: bool) -> np.ndarray:
    return nodes[::2] if periodic else np.unique(np.append(nodes[::2], nodes[-1]))
