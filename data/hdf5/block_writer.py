"""A table written block by block, safe against a kill at any moment and continued where it was stopped.

The work lies in ``PATH.part``: a whole HDF5 file with room for every cell, then a tail with one record for
each block. A block is marked after its cells, with their check sum, so a mark never stands for cells that are
not there.
"""

import contextlib
import hashlib
import json
import os
import struct
import zlib
from pathlib import Path

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import output_errors, publish, refuse_existing
from gonio.data.hdf5 import schema as hdf5_format
from gonio.data.layouts import Layout
from gonio.models.errors import GonioError

try:
    import fcntl
except ImportError:  # not a POSIX system: two writers of one file are not kept apart
    fcntl = None

RECORD = np.dtype([("done", "<u4"), ("crc", "<u4")])
FOOTER = struct.Struct("<32sQ8s")
MAGIC = b"GONIOPRT"
BLOCK_CELLS = 1 << 18


class BlockWriter:
    """Writes the table of one layout to `path`, block by block, in any order; a context manager.

    `recipe` is all that determines the values (anything JSON can hold): a ``PATH.part`` left by a killed
    writer of the same recipe, layout, channels, dtype and blocks is continued; one of another recipe is
    refused unless `force`. `u_f`: True stores a value for each cell; a number stands for all without taking
    room (0: exact, NaN: unknown, False is 0). `blocks` are ranges (start, stop) of cells in C order, of
    `block_cells` each (default: whole rows, about 2^18 cells).

    Raises GonioError where the target exists and not `force`, another process is writing it, its folder
    cannot be written, or the disk has no room for the whole table.
    """

    def __init__(
        self,
        path: str | os.PathLike,
        layout: Layout,
        channels: Channels,
        dtype=np.float64,
        recipe: dict | None = None,
        provenance: dict | None = None,
        force: bool = False,
        u_f: bool | float = True,
        *,
        name: str = "",
        source_solid_angle: float | None = None,
        receiver_solid_angle: float | None = None,
        block_cells: int | None = None,
    ):
        self.path = Path(path)
        self.part = Path(f"{path}.part")
        if block_cells is None:
            row = layout.row_size
            block_cells = max(1, BLOCK_CELLS // row) * row if row <= BLOCK_CELLS else BLOCK_CELLS
        size = layout.size
        self.blocks = [(start, min(start + block_cells, size)) for start in range(0, size, block_cells)]
        self._stored = u_f is True
        self._recipe = _digest(recipe or {}, layout, channels, np.dtype(dtype), u_f, block_cells)
        refuse_existing(self.path, force)
        attributes = hdf5_format.attributes_of(
            layout, channels, provenance or {}, source_solid_angle, receiver_solid_angle, name
        )
        with output_errors(self.path):
            self._file = self._continue(force)
            if self._file is None:
                constant = None if self._stored else float(u_f)
                self._file = self._begin(layout, channels, dtype, constant, attributes)

    def __enter__(self):
        return self

    def __exit__(self, *_):
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
        given = {"f": f, "flag": flag, "u_f": u_f} if self._stored else {"f": f, "flag": flag}
        crc = 0
        with output_errors(self.path):
            for what, values in given.items():
                offset, dtype = self._places.of(what)
                cells = np.ascontiguousarray(values, dtype)
                if cells.size != (stop - start) * self._places.channels:
                    raise ValueError(f"{what} has shape {cells.shape} for the {stop - start} cells of block {block}")
                self._file.seek(offset + start * self._places.channels * dtype.itemsize)
                write_all(self._file, cells)
                crc = zlib.crc32(cells.data, crc)
            self._records[block] = (1, crc)
            self._file.seek(self._tail + block * RECORD.itemsize)
            self._file.write(self._records[block].tobytes())

    @property
    def provenance(self) -> dict:
        """What the file says of how it came about; where this writer goes on, the words of the one that began it."""
        offset, length = hdf5_format.provenance_place(self.part)
        self._file.seek(offset)
        return json.loads(self._file.read(length))

    def amend(self, provenance: dict) -> None:
        """Replaces the provenance, at once, by one that is at most `PROVENANCE_ROOM` longer."""
        offset, length = hdf5_format.provenance_place(self.part)
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

    def _begin(self, layout, channels, dtype, constant, attributes):
        file = None
        try:
            self._places = hdf5_format.create(self.part, layout, channels, dtype, constant, attributes)
            file = _locked(self.part)
            self._tail = file.seek(0, os.SEEK_END)
            self._records = np.zeros(len(self.blocks), RECORD)
            size = self._tail + self._records.nbytes + FOOTER.size
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            file.seek(self._tail)
            file.write(self._records.tobytes() + FOOTER.pack(self._recipe, len(self.blocks), MAGIC))
        except BaseException:
            if file is not None:
                file.close()
            self.part.unlink(missing_ok=True)
            raise
        return file

    def _continue(self, force):
        if not self.part.exists():
            return None
        file = _locked(self.part)
        with contextlib.suppress(OSError, KeyError, struct.error):  # killed while it was being made: begin anew
            end = file.seek(0, os.SEEK_END)
            file.seek(max(end - FOOTER.size, 0))
            recipe, count, magic = FOOTER.unpack(file.read())
            self._tail = end - FOOTER.size - count * RECORD.itemsize
            if magic == MAGIC and self._tail > 0:
                if recipe == self._recipe and count == len(self.blocks):
                    self._places = hdf5_format.places(self.part)
                    file.seek(self._tail)
                    self._records = np.frombuffer(file.read(count * RECORD.itemsize), RECORD).copy()
                    self._verify(file)
                    return file
                if not force:
                    file.close()
                    raise GonioError(
                        f"{self.part} holds an unfinished measurement of another recipe; "
                        "finish that one, remove the file, or --force to begin anew"
                    )
        file.close()
        self.part.unlink()
        return None

    def _verify(self, file):
        """A block whose cells did not reach the disk (a power cut) does not count as done."""
        for block in np.flatnonzero(self._records["done"]):
            start, stop = self.blocks[block]
            crc = 0
            for what in ("f", "flag", "u_f") if self._stored else ("f", "flag"):
                offset, dtype = self._places.of(what)
                cell = self._places.channels * dtype.itemsize
                file.seek(offset + start * cell)
                crc = zlib.crc32(file.read((stop - start) * cell), crc)
            if crc != self._records["crc"][block]:
                self._records["done"][block] = 0


def write_all(file, array: np.ndarray) -> None:
    """Writes a contiguous array to an unbuffered file, however few bytes the system takes at a time."""
    rest = memoryview(array).cast("B")
    while rest:
        rest = rest[file.write(rest) :]


def _locked(path):
    # It stays open, and locked, until its writer is closed.
    file = open(path, "r+b", buffering=0)  # noqa: SIM115
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            raise GonioError(f"{path} is being written by another process; wait for it, or stop it") from None
    return file


def _digest(recipe, layout: Layout, channels: Channels, dtype, u_f, block_cells) -> bytes:
    digest = hashlib.sha256(json.dumps(recipe, sort_keys=True, separators=(",", ":")).encode())
    rest = [
        layout.name,
        channels.names,
        channels.wavelengths_nm,
        dtype.str,
        repr(float(u_f)),
        u_f is True,
        block_cells,
    ]
    digest.update(json.dumps(rest).encode())
    for axis in layout.axes.values():
        digest.update(axis.tobytes())
    return digest.digest()
