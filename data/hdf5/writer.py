"""The HDF5 file of a table: written whole or block by block, opened again."""

import os
from pathlib import Path

import numpy as np

from gonio.data.files import new_file
from gonio.data.hdf5.block_writer import BlockWriter
from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.schema import TableHeader, create
from gonio.data.round_trip import RoundTrip, compare_cells
from gonio.data.table import Table

__all__ = ["BlockWriter", "TableHeader", "open_table", "write_table"]


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
        locations = create(temporary, header, constant)
        with temporary.open("r+b", buffering=0) as file:
            for start, stop in table.blocks():
                locations.write(file, start, table.read_values(start, stop))
    return Path(path)


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
