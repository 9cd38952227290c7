"""Anisotropic BRDFs of MIT CSAIL [Ngan 2005]: 16 int32, then float32 planes R, G, B over both polar angles, the
detector's azimuth from the light's, and the light's azimuth, which changes fastest. Negative: not measured.
"""

import math
import os

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import stem, whole_size
from gonio.data.flags import Flag
from gonio.data.formats.laboratory.utia import scale_factor
from gonio.data.table import Table
from gonio.models.errors import GonioError

HEADER = np.dtype("<i4")
HEADER_BYTES = 64
MOST_BYTES = 1 << 29
"""Of a file: published ones have 394 million."""


def is_csail(start: bytes) -> bool:
    """Whether a file begins with such a header: four counts, standard coordinates in even bins, three channels."""
    if len(start) < HEADER_BYTES:
        return False
    header = np.frombuffer(start[:HEADER_BYTES], HEADER)
    counts = header[:4]
    return bool(
        (counts > 0).all() and (counts <= 3600).all() and tuple(header[6:8]) == (1, 0) and header[9] in (0, 1)
        and header[10] == 3
    )  # fmt: skip


def read_csail(path: str | os.PathLike[str], nodes: str = "centre", scale: float | None = None) -> Table:
    """The table of a file; the numbers are f, 1/sr, but for a stated scale.

    Args:
        path: the file.
        nodes: where a node lies in its bin: at its "centre" or its "lower" edge.
        scale: f over the file's numbers; 1 otherwise.

    Raises:
        GonioError: where header and size disagree; an unknown place of nodes.
    """
    factor = scale_factor(scale)
    if nodes not in ("centre", "lower"):
        raise GonioError(f"nodes {nodes!r} are unknown; expected 'centre' (the default) or 'lower'")
    if (size := whole_size(path)) > MOST_BYTES:
        raise GonioError(f"{path} has {size >> 20} MiB; a CSAIL file has at most {MOST_BYTES >> 20}")
    with open(path, "rb") as file:
        start = file.read(HEADER_BYTES)
        counts = [int(n) for n in np.frombuffer(start[:16], HEADER)]
        half = bool(np.frombuffer(start, HEADER)[9])
        cells = math.prod(counts)
        if size != HEADER_BYTES + 12 * cells:
            claimed = " × ".join(map(str, counts))
            raise GonioError(f"{path} claims {claimed} bins, which does not fit its {size:,} bytes; copy it again")
        f = np.empty((counts[0], counts[3], counts[1], counts[2], 3), np.float32)
        for channel in range(3):
            plane = np.fromfile(file, "<f4", cells).reshape(counts)
            f[..., channel] = np.transpose(plane, (0, 3, 1, 2))
    spans = (math.pi / 2, math.pi / 2, math.pi if half else 2 * math.pi, 2 * math.pi)
    shift = 0.5 if nodes == "centre" else 0.0
    axes = [(np.arange(n) + shift) / n * span for n, span in zip(counts, spans, strict=True)]
    flag = np.zeros(f.shape, np.uint8)
    flag[f < 0] = Flag.NOT_MEASURED
    flag[~np.isfinite(f)] = Flag.INVALID
    f[flag != Flag.VALID] = np.nan
    with np.errstate(over="ignore"):
        f *= np.float32(factor)
    flag[(flag == Flag.VALID) & ~np.isfinite(f)] = Flag.INVALID
    assumed = [f"a node is its bin's {'lower edge' if nodes == 'lower' else 'centre'}"]
    assumed += [
        f"f is {factor:g} times the file's numbers (--scale), 1/sr",
        "the mirror side is at a difference of 180°",
    ]
    assumed += ["differences of azimuth are of one side: the other is taken as its mirror image"] if half else []
    table = Table(layouts.turned(axes[0], axes[3], axes[1], axes[2]), f, flag, Channels.rgb(), name=stem(path))
    table.provenance = {"format": "CSAIL", "source": os.path.basename(path), "nodes": nodes, "assumptions": assumed}
    return table
