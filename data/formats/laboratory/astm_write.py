"""Writing ASTM E1392/E2387 text: a row for each direction that was read in every channel."""

import os
import re

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import new_file
from gonio.data.flags import Flag
from gonio.data.formats.csv.table_file import written_cells
from gonio.data.formats.laboratory.astm import ANGLES, read_astm
from gonio.data.formats.laboratory.matched import matched
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table
from gonio.models.errors import GonioError


def write_astm(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes the directions of a table that are valid in all channels, and returns what reading them shows to be lost.

    Angles in radians, every number so that reading it gives the same float; the format has no uncertainties and no
    flags. Raises GonioError for a table without such a direction, and where `path` cannot be written.
    """
    cells = written_cells(table)
    values = table.values_at(cells)
    whole = (values["flag"] == Flag.VALID).all(axis=1)
    if not whole.any():
        raise GonioError(f"no direction of the table has a valid reading in every channel; nothing to write to {path}")
    rows = np.column_stack([*(a[cells][whole] for a in table.layout.angles()), values["f"][whole]])
    names = _names(table.channels)
    header = [f"SAMPLE {re.sub(r'[^ -~]', '?', table.name)}"] if table.name.strip() else []
    header += [f"NUM_POINTS {len(rows)}", f"VARS {','.join((*ANGLES, *names))}"]
    notes = [f"{(~whole).sum()} directions without a reading in every channel left out"] if not whole.all() else []
    notes += ["without the uncertainties"] if table.u_f is not None else []
    with new_file(path, force) as temporary:
        with temporary.open("w", encoding="ascii") as file:
            file.write("\n".join(header) + "\n")
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows.tolist())
        again = read_astm(temporary, quantity="brdf")
    return matched(table, again, "; ".join(notes))


def _names(channels: Channels) -> list[str]:
    """The names of the channels as variables: no commas, nothing beyond ASCII, none twice."""
    if channels.wavelengths_nm is not None and len(set(channels.wavelengths_nm)) == len(channels):
        return [f"{w!r}nm" for w in channels.wavelengths_nm]
    if len(channels) == 1 and channels.names == ("grey",):
        return ["Integrated"]
    names = [re.sub(r"[^!-+\--~]", "_", name) or "_" for name in channels.names]
    return names if len(set(names)) == len(names) else [f"channel_{k + 1}" for k in range(len(names))]
