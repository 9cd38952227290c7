"""A table written to an HDF5 file: whole, or block by block and continued where it was stopped.

Unfinished work lies in ``PATH.part``: a whole HDF5 file with room for every cell, then a tail with one record for
each block. A block is marked after its cells, with their check sum, so that a mark stands for cells that are there,
whenever the writer is killed.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from io import FileIO
from pathlib import Path
from typing import Self

import numpy as np

from gonio.data.files import UNFINISHED, new_file, output_errors, publish, refuse_existing, temporary_beside
from gonio.data.hdf5 import schema
from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.schema import FOOTER, MAGIC, RECORD, CellLocations, TableHeader
from gonio.data.round_trip import RoundTrip, compare_cells
from gonio.data.table import Table
from gonio.models.errors import GonioError

__all__ = ["BlockWriter", "TableHeader", "open_table", "write_compared", "write_table"]

try:
    import fcntl
except ImportError:  # not a POSIX system: two writers of one file are not kept apart
    fcntl = None

BLOCK_CELLS = 1 << 18


class BlockWriter:
    """Writes a table to `path`, block by block, in any order; a context manager.

    Args:
        path: the finished file.
        header: all but the values.
        recipe: all that determines the values (anything JSON can hold): a ``PATH.part`` left by a killed writer of the
            same recipe, header and blocks is continued; one of another recipe is refused unless `force`.
        force: replace an existing file.
        u_f: True stores a value for each cell; a number stands for all without taking room (0: exact, NaN: unknown,
            False is 0).
        block_cells: cells of a block; by default whole rows, about 2^18 cells.

    `blocks` are ranges (start, stop) of cells in C order.

    Raises:
        GonioError: the target exists and not `force`, another process is writing it, its folder cannot be written, or
            the disk has no room for the whole table.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        header: TableHeader,
        recipe: dict | None = None,
        force: bool = False,
        u_f: bool | float = True,
        block_cells: int | None = None,
    ) -> None:
        self.path, self.part = Path(path), Path(f"{path}{UNFINISHED}")
        row, size = header.layout.row_size, header.layout.size
        if block_cells is None:
            block_cells = max(1, BLOCK_CELLS // row) * row if row <= BLOCK_CELLS else BLOCK_CELLS
        self.blocks = [(start, min(start + block_cells, size)) for start in range(0, size, block_cells)]
        self._recipe = _digest(recipe or {}, header, u_f, block_cells)
        refuse_existing(self.path, force)
        with output_errors(self.path):
            started = self._continue(force) or self._begin(header, None if u_f is True else float(u_f))
        self._file, self._locations, self._records, self._tail = started

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stops here. What is written stays in ``PATH.part`` for the next time; a part without a block is removed."""
        if not self._file.closed:
            if not self._records["done"].any():
                self.part.unlink(missing_ok=True)
            self._file.close()

    def missing_blocks(self) -> list[int]:
        """Numbers of the blocks that are still to be written."""
        return [int(k) for k in np.flatnonzero(self._records["done"] == 0)]

    def write(self, block: int, f: np.ndarray, u_f: np.ndarray | None, flag: np.ndarray) -> None:
        """Writes the cells of block number `block`: arrays of ``(cells, channels)``, or of that many values."""
        start, stop = self.blocks[block]
        values = {"f": f, "flag": flag, "u_f": u_f}
        for name in self._locations.offsets:
            if np.size(values[name]) != (stop - start) * self._locations.channels:
                cells = f"the {stop - start} cells of block {block}"
                raise ValueError(f"{name} has shape {np.shape(values[name])} for {cells}")
        with output_errors(self.path):
            self._records[block] = (1, self._locations.write(self._file, start, values))
            self._file.seek(self._tail + block * RECORD.itemsize)
            self._file.write(self._records[block].tobytes())

    @property
    def provenance(self) -> dict:
        """The provenance in the file; where this writer goes on, that of the one that began it."""
        offset, length = schema.provenance_location(self.part)
        self._file.seek(offset)
        return json.loads(self._file.read(length))

    def amend(self, provenance: dict) -> None:
        """Replaces the provenance, at once, by one that is at most `PROVENANCE_ROOM` longer."""
        offset, length = schema.provenance_location(self.part)
        text = json.dumps(provenance, sort_keys=True).encode()
        if len(text) > length:
            raise ValueError(f"a provenance of {len(text)} bytes does not fit the {length} that were kept for it")
        with output_errors(self.path):
            self._file.seek(offset)
            self._file.write(text.ljust(length))

    def finish(self) -> Path:
        """Puts the finished table in its place, on disk, and returns its path."""
        if self.missing_blocks():
            raise ValueError(f"{len(self.missing_blocks())} blocks of {self.path} are not written yet")
        with output_errors(self.path):
            publish(self.part, self.path)
            # After the renaming: bytes behind an HDF5 file's end do no harm, a part without its tail is lost work.
            self._file.truncate(self._tail)
            self._file.close()
        return self.path

    def _begin(self, header: TableHeader, constant: float | None) -> "_Started":
        # Whole before it has its name: what stands under that name is then either of gonio and known, or a stranger's.
        file, temporary = None, temporary_beside(self.part)
        try:
            locations = schema.create(temporary, header, constant)
            file = _locked(temporary)
            tail = file.seek(0, os.SEEK_END)
            records = np.zeros(len(self.blocks), RECORD)
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, tail + records.nbytes + FOOTER.size)
            file.seek(tail)
            file.write(records.tobytes() + FOOTER.pack(self._recipe, len(self.blocks), MAGIC))
            self._take_name(temporary)
        except BaseException:
            if file is not None:
                file.close()
            temporary.unlink(missing_ok=True)
            raise
        return file, locations, records, tail

    def _take_name(self, temporary: Path) -> None:
        try:
            os.link(temporary, self.part)
        except FileExistsError:
            raise GonioError(f"{self.part} is being written by another process; wait for it, or stop it") from None
        except OSError:  # a file system without links
            temporary.rename(self.part)
        else:
            temporary.unlink()

    def _continue(self, force: bool) -> "_Started | None":
        if not os.path.lexists(self.part):
            return None
        if self.part.is_symlink() or not self.part.is_file():
            raise GonioError(f"{self.part} is a link, a folder or a device; remove it, or give another output")
        file = _locked(self.part)
        try:
            started = self._unfinished(file, force)
        except BaseException:
            file.close()
            raise
        if started is None:
            file.close()
            self.part.unlink()
        return started

    def _unfinished(self, file: FileIO, force: bool) -> "_Started | None":
        """The state of a part of the same recipe; None where it may be removed: it is empty, or `force` says so."""
        end = file.seek(0, os.SEEK_END)
        file.seek(max(end - FOOTER.size, 0))
        recipe, count, magic = FOOTER.unpack(file.read().rjust(FOOTER.size, b"\0"))
        tail = end - FOOTER.size - count * RECORD.itemsize
        known = magic == MAGIC and tail > 0
        if known and recipe == self._recipe and count == len(self.blocks):
            with contextlib.suppress(OSError, KeyError):
                locations = schema.cell_locations(self.part)
                file.seek(tail)
                records = np.frombuffer(file.read(count * RECORD.itemsize), RECORD).copy()
                # A block whose cells did not reach the disk (a power cut) does not count as done.
                for block in np.flatnonzero(records["done"]):
                    if locations.check_sum(file, *self.blocks[block]) != records["crc"][block]:
                        records["done"][block] = 0
                return file, locations, records, tail
        if force or not end:
            return None
        what = "holds an unfinished measurement of another recipe" if known else "is no unfinished measurement of gonio"
        raise GonioError(f"{self.part} {what}; finish or remove it, or --force to replace it")


_Started = tuple[FileIO, CellLocations, np.ndarray, int]


def _locked(path: Path) -> FileIO:
    # It stays open, and locked, until its writer is closed.
    file = open(path, "r+b", buffering=0)  # noqa: SIM115
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            raise GonioError(f"{path} is being written by another process; wait for it, or stop it") from None
    return file


def _digest(recipe: dict, header: TableHeader, u_f: bool | float, block_cells: int) -> bytes:
    digest = hashlib.sha256(json.dumps(recipe, sort_keys=True, separators=(",", ":")).encode())
    channels, stored = header.channels, [repr(float(u_f)), u_f is True, block_cells]
    rest = [header.layout.name, channels.names, channels.wavelengths_nm, np.dtype(header.dtype).str, *stored]
    digest.update(json.dumps(rest).encode())
    for axis in header.layout.axes.values():
        digest.update(axis.tobytes())
    return digest.digest()


def write_table(path: str | os.PathLike[str], table: Table, force: bool = False) -> Path:
    """Writes a table as one HDF5 file, whole or not at all, and returns its path.

    An uncertainty that is the same everywhere (0: exact, None or NaN: unknown) takes no room. Raises GonioError where
    `path` exists (unless `force`) or cannot be written.
    """
    header = TableHeader(
        table.layout, table.channels, table.f.dtype, table.provenance, table.name,
        table.source_solid_angle, table.receiver_solid_angle,
    )  # fmt: skip
    constant = _constant_uncertainty(table)
    with new_file(path, force) as temporary:
        blocks = ((start, table.read_values(start, stop)) for start, stop in table.blocks())
        write_cells(temporary, header, constant, blocks)
    return Path(path)


def write_cells(
    path: Path, header: TableHeader, u_f: float | None, blocks: Iterable[tuple[int, Mapping[str, np.ndarray | None]]]
) -> None:
    """Writes a file from blocks of cells, each with the number of its first one. `u_f`: a number for all, or None."""
    locations = schema.create(path, header, u_f)
    with path.open("r+b", buffering=0) as file:
        for start, values in blocks:
            locations.write(file, start, values)


def write_compared(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes a table as `write_table` does, and returns what reading it again shows to be lost."""
    written = open_table(write_table(path, table, force))
    return compare_cells(table.read_values(), written.read_values())


def _constant_uncertainty(table: Table) -> float | None:
    """0 or NaN where every cell has that uncertainty, else None."""
    if table.u_f is None:
        return float("nan")
    blocks = [table.read_values(*block)["u_f"] for block in table.blocks()]
    if not any(u_f.any() for u_f in blocks):
        return 0.0
    return float("nan") if all(np.isnan(u_f).all() for u_f in blocks) else None
