"""BRDFs of UTIA's data base: headerless float64, three planes over all four angles in steps of 15° and 7.5°.

Polar angles end at 75°. The absolute scale is not said: programs of the field take the numbers as f in 1/sr, or
multiply them, or undo the gamma of sRGB first.
"""

import math
import os

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import input_size, stem
from gonio.data.flags import Flag
from gonio.data.plausibility.suspicions import QUANTITY_REMEDY, suspicions
from gonio.data.table import Table
from gonio.models.errors import GonioError

POLAR = np.radians(np.arange(6) * 15.0)
AZIMUTHS = np.radians(np.arange(48) * 7.5)
SHAPE = (POLAR.size, AZIMUTHS.size, POLAR.size, AZIMUTHS.size)
BYTES = 3 * 8 * math.prod(SHAPE)
"""Of such a file."""


def read_utia(path: str | os.PathLike[str], scale: float | None = None) -> Table:
    """The table of a UTIA file, R, G, B. Negative readings are kept.

    Args:
        path: the file.
        scale: f, 1/sr, over the file's numbers; 1 otherwise.

    Raises:
        GonioError: another size of the file, or a scale that is none.
    """
    factor = scale_factor(scale)
    if (size := input_size(path)) != BYTES:
        raise GonioError(f"{path} has {size:,} bytes, and a UTIA BRDF {BYTES:,}; copy it again")
    f = np.moveaxis(np.fromfile(path, "<f8").reshape(3, *SHAPE), 0, -1)
    with np.errstate(over="ignore", invalid="ignore"):
        f = np.ascontiguousarray(f) * factor
    flag = np.where(np.isfinite(f), np.uint8(Flag.VALID), np.uint8(Flag.INVALID))
    f[flag != Flag.VALID] = np.nan
    assumed = [f"f is {factor:g} times the file's numbers (--scale), 1/sr", "azimuths are those of vectors"]
    table = Table(layouts.spherical(POLAR, AZIMUTHS, POLAR, AZIMUTHS), f, flag, Channels.rgb(), name=stem(path))
    table.provenance = {"format": "UTIA", "source": os.path.basename(path), "scale": factor, "assumptions": assumed}
    warnings = suspicions(table, quantity_unknown=scale is None)
    if warnings := [w.replace(QUANTITY_REMEDY, "state --scale, 1 if it is so") for w in warnings]:
        table.provenance["warnings"] = warnings
    return table


def scale_factor(scale: float | None) -> float:
    """What a file's numbers are multiplied by, as a caller states it. Raises GonioError for what is no factor."""
    factor = 1.0 if scale is None else scale
    if isinstance(factor, str) or not 0 < factor < math.inf:
        raise GonioError(f"the scale is {factor!r}; give a number above 0")
    return float(factor)
