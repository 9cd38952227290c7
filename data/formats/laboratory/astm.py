"""ASTM E1392 and E2387 text as Cornell's program of computer graphics and libbsdf have it.

Header lines ``KEY value`` up to ``VARS theta_i,phi_i,theta_s,phi_s,...``, then rows of these variables, separated by
commas: angles in radians, readings of f in 1/sr. Without phi_i it is 0. Channels are R,G,B, X,Y,Z, wavelengths such
as 400nm, or any other names.
"""

import math
import os
import re

import numpy as np

from gonio.data.channels import Channels
from gonio.data.formats.csv.conventions import convention
from gonio.data.formats.csv.directions import UNITS
from gonio.data.formats.csv.listed_rows import Listing, rounding_of, table_of_listing
from gonio.data.formats.laboratory.number_rows import number_rows, text_lines
from gonio.data.table import Table
from gonio.models.errors import GonioError

VARIABLES = r"(?m)^[ \t\r]*+VARS[ \t][^\r\n]*theta_[is]\b"
"""How such a file is known."""
ANGLES = ("theta_i", "phi_i", "theta_s", "phi_s")
RADIANS_LIMIT = 3.15
"""Polar angles beyond are degrees."""
WAVELENGTH = re.compile(r"(\d+(?:\.\d+)?(?:[eE][-+]?\d+)?) *nm")
LONGEST_HEADER = 1000
"""Lines."""


def read_astm(
    path: str | os.PathLike[str],
    angles: str | None = None,
    quantity: str | None = None,
    mirror_azimuth: float | None = None,
) -> Table:
    """The table of an ASTM file: on the grid that its rows are, else scattered.

    Args:
        path: the file.
        angles: "radians", as the format has them, or "degrees".
        quantity: what the values are (a key of `gonio.data.quantities.QUANTITIES`); the BRDF otherwise.
        mirror_azimuth: phi_s − phi_i of the mirror side, degrees: 180 or 0.

    Raises:
        GonioError: with the line, for whatever is no reading.
    """
    if angles not in (None, *UNITS):
        raise GonioError(f"angles={str(angles)[:40]!r} is no unit of angles; give degrees or radians")
    how = convention(quantity, mirror_azimuth)
    lines = text_lines(path, "an ASTM file")
    first = next((k for k, line in enumerate(lines[:LONGEST_HEADER]) if line.split(None, 1)[:1] == ["VARS"]), None)
    if first is None:
        raise GonioError(f"{path} has no line that begins with VARS; expected VARS theta_i,phi_i,theta_s,phi_s,...")
    names = [name.strip() for name in lines[first].split(None, 1)[1].split(",")]
    missing = [name for name in ANGLES if name not in names and name != "phi_i"]
    values = [name for name in names if name not in ANGLES]
    if missing or not values or len(set(names)) < len(names):
        raise GonioError(
            f"{path} has the variables {', '.join(names)[:120]}; expected {', '.join(ANGLES)}, phi_i if it is not 0, "
            "and one name for each channel"
        )
    columns = dict(zip(names, number_rows(path, lines[first + 1 :], len(names), ",", first + 2).T, strict=True))
    zero = np.zeros(len(columns["theta_i"]))
    four = [columns.get(name, zero) for name in ANGLES]
    rounding = rounding_of(four, math.radians(1.0) if angles == "degrees" else 1.0)
    if angles == "degrees":
        four = [np.radians(a) for a in four]
    elif zero.size and max(np.abs(four[0]).max(), np.abs(four[2]).max()) > RADIANS_LIMIT:
        raise GonioError(f"{path} has polar angles above π, and the format's are radians; state --angles degrees")
    f = np.stack([columns[name] for name in values], axis=-1)
    listing = Listing((four[0], four[1], four[2], four[3]), f, astm_channels(values), rounding=rounding)
    understood = [f"angles are {angles or 'radians'}"]
    understood += ["there is no phi_i: it is 0"] if "phi_i" not in names else []
    about = {"format": "ASTM", **_header(lines[:first]), "understood": understood}
    return table_of_listing(path, listing, how, about)


def astm_channels(names: list[str]) -> Channels:
    """The channels of the variables' names. Raises GonioError for wavelengths that are none."""
    matches = [WAVELENGTH.fullmatch(name) for name in names]
    if all(matches) and len(set(names)) == len(names):
        return Channels.of_wavelengths([float(m[1]) for m in matches if m])
    return Channels(tuple(names))


def _header(lines: list[str]) -> dict[str, dict[str, str]]:
    """What the header states, by its keys."""
    words = [line.split(None, 1) for line in lines if line.strip() and not line.lstrip().startswith("#")]
    stated = {w[0][:80]: w[1].strip()[:400] for w in words if len(w) == 2}
    return {"header": dict(list(stated.items())[:100])} if stated else {}
