"""Writing UTIA's grid of a table or a model."""

import os

import numpy as np

from gonio.data import layouts
from gonio.data.files import new_file
from gonio.data.flags import Flag
from gonio.data.formats.laboratory.matched import sampled_error
from gonio.data.formats.laboratory.utia import AZIMUTHS, POLAR, SHAPE, read_utia
from gonio.data.interpolation.coverage import require_readings_on
from gonio.data.interpolation.multilinear import as_material
from gonio.data.material import Material
from gonio.data.reflection_only import require_reflection
from gonio.data.round_trip import RoundTrip, compare_cells
from gonio.data.table import Table
from gonio.data.tabulate import grid_values
from gonio.models.errors import GonioError


def write_utia(path: str | os.PathLike[str], source: Table | Material, force: bool = False) -> RoundTrip:
    """Writes a table or a model on UTIA's grid, and returns what reading the file again shows to be lost.

    A table on that grid is written cell by cell, any other is interpolated; what has no value is interpolated too, as
    the format has no sign for it. One channel is repeated; the numbers are f, 1/sr.

    Args:
        path: the file.
        source: a table, or a material.
        force: replaces an existing file.

    Raises:
        GonioError: what transmits, other than one or three channels, a table with readings about less than half of the
            directions, and where `path` cannot be written.
    """
    name, channels = source.name or "the table", len(source.channels)
    require_reflection(source if isinstance(source, Table) else source.brdf, name, "a UTIA file")
    if channels not in (1, 3):
        raise GonioError(f"a UTIA file holds R, G, B, but there are {channels} channels; choose one or three")
    grid = layouts.spherical(POLAR, AZIMUTHS, POLAR, AZIMUTHS)
    table = source if isinstance(source, Table) and source.layout == grid else None
    valid = np.ones((*SHAPE, channels), bool) if table is None else np.asarray(table.flag[...]) == Flag.VALID
    f = np.zeros(valid.shape) if table is None else np.asarray(table.f[...])
    note = require_readings_on(source, grid) if table is None and isinstance(source, Table) else ""
    if table is None or not valid.all():
        brdf = as_material(source) if isinstance(source, Table) else source.brdf
        f = np.where(valid & (table is not None), f, grid_values(brdf, grid))
    planes = np.moveaxis(np.broadcast_to(f, (*SHAPE, 3)), -1, 0).astype("<f8")
    with new_file(path, force) as temporary:
        with temporary.open("wb") as file:
            file.write(np.ascontiguousarray(planes).data)
        again = read_utia(temporary, 1.0)
    if table is not None:
        filled = int(valid.size - np.count_nonzero(valid))
        note = f"{filled} cells without a value interpolated" if filled else ""
        return compare_cells(table.read_values(), again.read_values(), note)
    grid_note = "on the format's grid of 15° and 7.5°, up to 75°"
    return sampled_error(source, again, "; ".join(filter(None, [grid_note, note])))
