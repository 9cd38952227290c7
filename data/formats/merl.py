"""MERL's ``.binary`` files [Matusik 2003]: isotropic RGB tables on a half/difference grid.

Three little-endian int32 (theta_h, theta_d, phi_d counts), then the float64 planes R, G, B; value = raw × {1,
1.15, 1.66} / 1500; a negative value means no data.
"""

import math
import os
from typing import TYPE_CHECKING

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import new_file, stem, whole_size
from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.reflection_only import require_reflection
from gonio.data.round_trip import RoundTrip, compare, compare_cells
from gonio.data.table import Table, whole_table_of_values
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.brdf import AbstractBRDF

SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0
HEADER = np.dtype("<i4")
NO_DATA = -1.0


def header_counts(start: bytes, size: int) -> tuple[int, int, int] | None:
    """(theta_h, theta_d, phi_d) counts if these first bytes of a file of `size` bytes are MERL's, else None."""
    if len(start) < 12:
        return None
    h, d, p = (int(n) for n in np.frombuffer(start[:12], HEADER))
    return (h, d, p) if min(h, d, p) > 0 and size == 12 + 3 * 8 * h * d * p else None


def has_header(start: bytes, size: int) -> bool:
    """Whether a file begins with a header that fits its size, or with MERL's own counts, whatever its size."""
    own_counts = len(start) >= 12 and tuple(np.frombuffer(start[:8], HEADER)) == (90, 90)
    return header_counts(start, size) is not None or own_counts


def read_merl(path: str | os.PathLike[str], nodes: str = "lower") -> Table:
    """The table of a MERL file.

    Args:
        path: the file.
        nodes: whether a node is its bin's "lower" edge, as in the original look-up, or its "centre": readers of the
            field disagree. The provenance keeps it.

    Returns:
        f in 1/sr, float64. A file with 360 phi_d covers the whole circle (data that are not reciprocal), any other half
        of it.

    Raises:
        GonioError: header and file size disagree.
    """
    size = whole_size(path)
    with open(path, "rb") as file:
        start = file.read(12)
        counts = header_counts(start, size)
        if counts is None:
            claimed = " x ".join(str(n) for n in np.frombuffer(start[:12], HEADER)) if len(start) == 12 else "nothing"
            raise GonioError(
                f"{path} is no MERL file: its header claims {claimed} cells, which does not fit its {size} bytes; "
                "copy it again"
            )
        raw = np.fromfile(file, "<f8").reshape(3, -1)
    grid = _grid(nodes, counts)
    f = np.empty((grid.size, 3))
    np.multiply(raw.T, SCALE, out=f)
    flag = np.zeros(f.shape, np.uint8)
    below = ~grid.readable()
    stray = int(np.count_nonzero(f[below] >= 0))
    flag[f < 0] = Flag.NOT_MEASURED
    flag[~np.isfinite(f)] = Flag.INVALID
    flag[below] = Flag.BELOW_HORIZON
    f[flag != Flag.VALID] = np.nan
    assumed = [f"a node is its bin's {nodes} {'edge' if nodes == 'lower' else 'point'}"]
    if stray:
        assumed.append(f"{stray} values of cells below the horizon were not used")
    provenance = {"format": "MERL", "source": os.path.basename(path), "nodes": nodes, "assumptions": assumed}
    shape = (*grid.shape, 3)
    f, flag = f.reshape(shape), flag.reshape(shape)
    return Table(grid, f, flag, Channels.rgb(), provenance=provenance, name=stem(path))


def write_merl(
    path: str | os.PathLike[str], source: "Table | AbstractBRDF", force: bool = False, nodes: str = "lower"
) -> RoundTrip:
    """Writes a table, or a model, as a MERL file.

    A table on MERL's grid is written cell by cell; any other is interpolated onto 90 × 90 × 180 nodes. One channel is
    repeated. MERL has no sign for a negative reading: those become "no data" and are counted as lost.

    Args:
        path: the file to write.
        source: a table of one or three channels, or a model.
        force: whether `path` may be replaced.
        nodes: as of `read_merl`.

    Returns:
        What reading the file again shows to be lost; of an interpolated table, against the table's own cells.

    Raises:
        GonioError: other than one or three channels, a table with readings about less than half of the directions, or
            `path` cannot be written.
    """
    require_reflection(source, getattr(source, "name", "") or "the model", "a MERL file")
    from gonio.models.evaluation import channel_count

    count = len(source.channels) if isinstance(source, Table) else channel_count(source) or 1
    if count not in (1, 3):  # before a million cells of each are computed
        raise GonioError(f"a MERL file holds R, G, B, but there are {count} channels; choose one or three")
    table, continued = _on_merl_grid(source, nodes)
    values = table.read_values()
    keep = (values["flag"] == Flag.VALID) & (values["f"] >= 0)
    raw = np.where(keep, np.where(keep, values["f"], NO_DATA) / SCALE, NO_DATA)
    with new_file(path, force) as temporary:
        with temporary.open("wb") as file:
            file.write(np.array(table.layout.shape, HEADER).tobytes())
            file.write(np.ascontiguousarray(raw.T, "<f8").data)
        written = read_merl(temporary, nodes)
    if table is source or not isinstance(source, Table):
        return compare_cells(values, written.read_values(), f"nodes {nodes}")
    from gonio.data.interpolation.multilinear import as_material
    from gonio.models.evaluation import evaluate

    sample = source.samples(limit=100_000)
    interpolated = np.asarray(evaluate(as_material(written), sample.wi, sample.wo))
    valid = np.broadcast_to(sample.flag == Flag.VALID, interpolated.shape)
    f = np.broadcast_to(sample.f, interpolated.shape)
    note = f"interpolated from {source.layout.name} cells, nodes {nodes}" + (f"; {continued}" if continued else "")
    return compare(f, interpolated, valid, valid, note)


def _grid(nodes: str, counts: tuple[int, int, int]) -> Layout:
    return layouts.merl(nodes, counts, 2 * math.pi if counts[2] == 360 else math.pi)


def _on_merl_grid(source: "Table | AbstractBRDF", nodes: str) -> tuple[Table, str]:
    """(The source where it is a table on a grid of MERL's, else its values on that of MERL's own counts; a remark).

    The remark says how many directions have no reading.
    """
    from gonio.data.interpolation.coverage import require_readings_on
    from gonio.data.interpolation.multilinear import as_material
    from gonio.data.tabulate import grid_values

    grid, continued = layouts.merl(nodes), ""
    if isinstance(source, Table):
        counts = source.layout.shape
        if len(counts) == 3 and source.layout == _grid(nodes, counts):
            return source, ""
        continued = require_readings_on(source, grid)
        source = as_material(source)
    return whole_table_of_values(grid, grid_values(source, grid)), continued
