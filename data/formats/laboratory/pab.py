"""Text of pab's goniophotometers: a header of ``#key value``, then rows of theta, phi (degrees) and value.

A file has one incidence; files that were joined have several, each behind its own header.
"""

import math
import os
import re

import numpy as np

from gonio.data.channels import Channels
from gonio.data.formats.csv.conventions import convention
from gonio.data.formats.csv.listed_rows import Listing, rounding_of, table_of_listing
from gonio.data.formats.laboratory.number_rows import number_rows, text_lines
from gonio.data.table import Table
from gonio.models.errors import GonioError

SIGNATURE = r"(?m)^[ \t\r]*+#[ \t]*+(?:intheta|inphi|incident_angle|format:[ \t]*+theta[ \t]++phi)\b"
"""How such a file is known."""
QUANTITIES = {"bsdf": "brdf", "brdf": "brdf", "btdf": "brdf", "dsf": "brdf_cos"}
"""What the last word of ``#format: theta phi ...`` means."""
HEADER = re.compile(r"#\s*([A-Za-z_]+)\b:?\s*(.*)")
MOST_INCIDENCES = 10_000


class _Header:
    """What the header lines state so far; a later header replaces it."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = path
        self.stated: dict[str, str] = {}
        self.incidence: list[float | None] = [None, None]
        self.columns: list[str] = []

    def take(self, line: str) -> None:
        """Adds one line. Raises GonioError for an angle of incidence that is no number."""
        match = HEADER.match(line)
        if match is None:
            return
        key, value = match[1].lower(), match[2].strip()
        if key in ("intheta", "inphi"):
            self.incidence[key == "inphi"] = self._number(key, value)
        elif key == "incident_angle":
            self.incidence = [self._number(key, part) for part in [*value.split(), "", ""][:2]]
        elif key == "format":
            self.columns = value.lower().split()
        elif len(self.stated) < 100:
            self.stated[key] = value.strip('"')[:400]

    def _number(self, key: str, value: str) -> float:
        try:
            return float(value.split()[0])
        except (IndexError, ValueError):
            raise GonioError(f"{self.path}: #{key} is {value[:40]!r}; expected degrees") from None


def read_pab(path: str | os.PathLike[str], mirror_azimuth: float | None = None) -> Table:
    """The table of a file of one incidence, or of several that were joined: polar angles beyond 90° are behind.

    Args:
        path: the file.
        mirror_azimuth: phi − inphi of the mirror side, degrees: 180 or 0.

    Raises:
        GonioError: with the line, for whatever is no reading; a header without incidence or format.
    """
    how, header = convention(None, mirror_azimuth), _Header(path)
    lines, parts, quantities, start = text_lines(path, "a pab file"), [], set[str](), 0
    while start < len(lines):
        stop = next((k for k in range(start, len(lines)) if not _is_comment(lines[k])), len(lines))
        for line in lines[start:stop]:
            header.take(line)
        start = next((k for k in range(stop, len(lines)) if lines[k].lstrip().startswith("#")), len(lines))
        if not any(line.strip() for line in lines[stop:start]):
            continue
        quantities.add(_quantity(header))
        rows = number_rows(path, lines[stop:start], len(header.columns), "", stop + 1)
        theta_i, phi_i = header.incidence
        parts.append(np.column_stack([np.full(len(rows), theta_i), np.full(len(rows), phi_i), rows[:, :3]]))
        if len(parts) > MOST_INCIDENCES or len(quantities) > 1:
            raise GonioError(f"{path} joins files of {' and '.join(sorted(quantities))}, or too many; join fewer")
    if not parts:
        raise GonioError(f"{path} has no rows of readings behind its header; expected theta, phi and value")
    degrees = np.concatenate(parts)
    quantity, angles = quantities.pop(), np.radians(degrees[:, :4]).T
    rounding = rounding_of(degrees[:, :4].T, math.radians(1.0))
    listing = Listing((angles[0], angles[1], angles[2], angles[3]), degrees[:, 4:], Channels.grey(), rounding=rounding)
    about = {"format": "pab", "header": header.stated, "understood": []}
    about["understood"] += ["the values are DSF, with the cosine"] if quantity == "brdf_cos" else []
    how = how._replace(quantity=quantity, quantity_known=True)
    return table_of_listing(path, listing, how, about, header.stated.get("sample_name", ""))


def _is_comment(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _quantity(header: _Header) -> str:
    """A key of `gonio.data.quantities.QUANTITIES`. Raises GonioError for a header without format or incidence."""
    columns = header.columns
    quantity = QUANTITIES.get(columns[2]) if len(columns) > 2 and columns[:2] == ["theta", "phi"] else None
    if quantity is None:
        raise GonioError(
            f"{header.path} has the format {' '.join(header.columns)[:60]!r}; expected '#format: theta phi BSDF' or DSF"
        )
    if None in header.incidence:
        raise GonioError(
            f"{header.path} does not say the direction of the light; expected #intheta and #inphi, degrees"
        )
    return quantity
