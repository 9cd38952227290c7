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
from gonio.data.files import input_size, new_file
from gonio.data.flags import Flag
from gonio.data.formats.base import FileHead, Format
from gonio.data.layouts import Layout
from gonio.data.round_trip import RoundTrip, compare, compare_cells
from gonio.data.table import Table
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
    counts = tuple(int(n) for n in np.frombuffer(start[:12], HEADER))
    return counts if min(counts) > 0 and size == 12 + 3 * 8 * math.prod(counts) else None


def looks_like_merl(head: FileHead) -> bool:
    """Whether a file has MERL's header, its own counts (with a wrong size), or is a binary of its suffix.

    The reader says what is wrong with the latter two.
    """
    own_counts = len(head.start) >= 12 and tuple(np.frombuffer(head.start[:8], HEADER)) == (90, 90)
    return bool(header_counts(head.start, head.size)) or own_counts or (head.binary and head.suffix == ".binary")


def read_merl(path: str | os.PathLike[str], nodes: str = "lower") -> Table:
    """The table of a MERL file; f in 1/sr, float64.

    Readers of the field disagree whether a node is the bin's "lower" edge (the original look-up; default) or
    its "centre"; `nodes` says which, the provenance keeps it. A file with 360 phi_d covers the whole circle
    (data that are not reciprocal), any other half of it. Raises GonioError where header and file size
    disagree.
    """
    size = input_size(path)
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
    below = ~grid.above_horizon()
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
    name = os.path.splitext(os.path.basename(path))[0]
    return Table(grid, f.reshape(shape), flag.reshape(shape), Channels.rgb(), provenance=provenance, name=name)


def write_merl(
    path: str | os.PathLike[str], source: "Table | AbstractBRDF", force: bool = False, nodes: str = "lower"
) -> RoundTrip:
    """Writes a table, or a model, as a MERL file, and returns what reading it again shows to be lost.

    A table on MERL's grid is written cell by cell; any other is interpolated onto 90 × 90 × 180 nodes, and
    the round trip then compares the interpolated file with the table's own cells. One channel is repeated.
    MERL has no sign for a negative reading: those become "no data" and are counted as lost. Raises GonioError
    for other than one or three channels, and where `path` cannot be written.
    """
    from gonio.data.interpolation.multilinear import as_material

    table, direct = _on_merl_grid(source, nodes)
    if len(table.channels) not in (1, 3):
        raise GonioError(
            f"a MERL file holds R, G, B, but there are {len(table.channels)} channels; choose one or three"
        )
    values = table.read_values()
    keep = (values["flag"] == Flag.VALID) & (values["f"] >= 0)
    raw = np.where(keep, values["f"], NO_DATA)
    raw = np.where(keep, raw / SCALE, NO_DATA)
    with new_file(path, force) as temporary:
        with temporary.open("wb") as file:
            file.write(np.array(table.layout.shape, HEADER).tobytes())
            file.write(np.ascontiguousarray(raw.T, "<f8").data)
        read = read_merl(temporary, nodes)
    if direct:
        return compare_cells(table.read_values(), read.read_values(), f"nodes {nodes}")
    sample = source.samples(limit=100_000)
    from gonio.models.evaluation import evaluate

    again = np.asarray(evaluate(as_material(read), sample.wi, sample.wo))
    valid = sample.flag == Flag.VALID
    f = np.broadcast_to(sample.f, again.shape)
    valid = np.broadcast_to(valid, again.shape)
    return compare(f, again, valid, valid, f"interpolated from {source.layout.name} cells, nodes {nodes}")


def _grid(nodes: str, counts: tuple[int, int, int]) -> Layout:
    return layouts.merl(nodes, counts, 2 * math.pi if counts[2] == 360 else math.pi)


def _is_merl_grid(layout: Layout, nodes: str) -> bool:
    counts = layout.shape
    return len(counts) == 3 and layout == _grid(nodes, counts)


def _on_merl_grid(source, nodes) -> tuple[Table, bool]:
    """(a table on MERL's grid, whether it holds the source's own values)."""
    from gonio.data.interpolation.multilinear import as_material
    from gonio.data.table import whole_table_of_values
    from gonio.data.tabulate import grid_values

    if isinstance(source, Table) and _is_merl_grid(source.layout, nodes):
        return source, True
    grid = layouts.merl(nodes)
    brdf = as_material(source) if isinstance(source, Table) else source
    return whole_table_of_values(grid, grid_values(brdf, grid)), not isinstance(source, Table)


FORMAT = Format(
    "MERL", "MERL .binary", "table", looks_like_merl, read_merl, write_merl, options=("nodes",), suffixes=(".binary",)
)
