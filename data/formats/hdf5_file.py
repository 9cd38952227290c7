"""gonio's own HDF5 files as a format among the others."""

import os

from gonio.data.formats.base import FileHead, Format
from gonio.data.round_trip import RoundTrip, compare_cells
from gonio.data.table import Table

SIGNATURE = b"\x89HDF\r\n\x1a\n"


def looks_like_hdf5(head: FileHead) -> bool:
    """Whether a file is HDF5, of gonio or not: the reader says so."""
    return head.start.startswith(SIGNATURE)


def read_hdf5(path: str | os.PathLike[str]) -> Table:
    """`gonio.data.hdf5.reader.open_table`; h5py is loaded with the first such file."""
    from gonio.data.hdf5.reader import open_table

    return open_table(path)


def write_hdf5(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes a table and reads it again; see `gonio.data.hdf5.writer.write_table`."""
    from gonio.data.hdf5.writer import write_table

    written = read_hdf5(write_table(path, table, force))
    return compare_cells(table.read_values(), written.read_values())


FORMAT = Format(
    "HDF5", "a table of gonio (HDF5)", "table", looks_like_hdf5, read_hdf5, write_hdf5, suffixes=(".h5", ".hdf5", ".nc")
)
