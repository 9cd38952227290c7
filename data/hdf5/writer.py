"""The HDF5 file of a table: written whole or block by block, opened again."""

import os
from pathlib import Path

import numpy as np

from gonio.data.files import new_file
from gonio.data.hdf5 import schema as hdf5_format
from gonio.data.hdf5.block_writer import BlockWriter, write_all
from gonio.data.hdf5.reader import open_table
from gonio.data.table import Table

__all__ = ["BlockWriter", "open_table", "write_table"]


def write_table(path: str | os.PathLike, table: Table, force: bool = False) -> Path:
    """Writes a table as one HDF5 file, whole or not at all. Raises GonioError where `path` cannot be written.

    An uncertainty that is the same everywhere (0: exact, None or NaN: unknown) takes no room.
    """
    constant = _constant_uncertainty(table)
    attributes = hdf5_format.attributes_of(
        table.layout,
        table.channels,
        table.provenance,
        table.source_solid_angle,
        table.receiver_solid_angle,
        table.name,
    )
    with new_file(path, force) as temporary:
        dtype = np.dtype(table.f.dtype)
        places = hdf5_format.create(temporary, table.layout, table.channels, dtype, constant, attributes)
        with temporary.open("r+b", buffering=0) as file:
            for start, stop in table.blocks():
                block = table.read_values(start, stop)
                for what in ("f", "flag") if constant is not None else ("f", "flag", "u_f"):
                    offset, kind = places.of(what)
                    file.seek(offset + start * places.channels * kind.itemsize)
                    write_all(file, np.ascontiguousarray(block[what], kind))
    return Path(path)


def _constant_uncertainty(table: Table) -> float | None:
    if table.u_f is None:
        return float("nan")
    kinds = set()
    for start, stop in table.blocks():
        u_f = table.read_values(start, stop)["u_f"]
        kinds.add(0.0 if not u_f.any() else float("nan") if np.isnan(u_f).all() else None)
    values = {repr(k): k for k in kinds}
    return values.popitem()[1] if len(values) == 1 else None
