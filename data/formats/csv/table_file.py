"""Plain CSV: what `gonio convert` and `gonio eval` write, and what people, spreadsheets and instruments do.

Columns by name, in any order: theta_i, phi_i, theta_o, phi_o in degrees, or wi_x, wi_y, wi_z, wo_x, wo_y,
wo_z; `f`, or `f_450nm`, ..., `f_R`, `f_G`, `f_B`, or `f_1`, `f_2`, ... for channels, in 1/sr without the cosine;
optionally `u_f` (or `u_f_450nm`, ...), the standard uncertainty (nan: unknown, 0: exact), and `flag` (or
`flag_450nm`, ...). Polar angles beyond 90 degrees are behind the sample. Other names, units, delimiters and quantities
are read where they say what they are; what was understood stands in the table's provenance.
"""

import json
import os
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import new_file, stem
from gonio.data.flags import Flag
from gonio.data.formats.csv.columns import CsvText, write_columns
from gonio.data.formats.csv.cut_off import cut_off, ends_early
from gonio.data.formats.csv.directions import Directions, direction_columns, read_angles
from gonio.data.formats.csv.header import ANGLES, LENGTHS_NM, VECTORS, value_names
from gonio.data.formats.csv.listed_rows import SAME_DIRECTION, table_of_rows
from gonio.data.formats.csv.readings import Readings, by_wavelength, read_values
from gonio.data.formats.csv.statements import Statements
from gonio.data.formats.csv.values import value_columns
from gonio.data.layouts import Layout
from gonio.data.layouts.recognition import Placement, recognised
from gonio.data.plausibility.suspicions import suspicions
from gonio.data.quantities import QUANTITIES, brdf_of
from gonio.data.round_trip import RoundTrip, compare
from gonio.data.table import MEDIA, Table, media_of
from gonio.models.errors import GonioError, nearest
from gonio.models.geometry.sides import FRONT

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction


def read_csv(
    path: str | os.PathLike[str],
    angles: str | None = None,
    quantity: str | None = None,
    missing: str | float | None = None,
    mirror_azimuth: float | None = None,
    coverage: float | None = None,
) -> Table:
    """The table of a CSV file: on the grid that its rows are, else scattered.

    Args:
        path: the file.
        angles: "degrees" or "radians", where neither header nor comments say it; degrees otherwise.
        quantity: what the values are (a key of `gonio.data.quantities.QUANTITIES`); the BRDF otherwise.
        missing: the number that stands for no reading, or "none".
        mirror_azimuth: phi_o − phi_i of the mirror side, degrees: 180 (the usual one) or 0.
        coverage: standard uncertainties in the file's; otherwise what header or comments say, 2 of expanded ones, 1.

    Returns:
        The table. Its provenance has `understood` and `warnings`, lists of sentences.

    Raises:
        GonioError: with the line, for whatever is no reading; readings on the horizon have no value (BELOW_HORIZON).
    """
    if quantity is not None and quantity not in QUANTITIES:
        raise GonioError(f"quantity {str(quantity)[:40]!r} is unknown; {nearest(str(quantity), QUANTITIES)}")
    text = CsvText(path)
    statements = Statements(text.path, text.comments)
    values = value_columns(text, statements, quantity)
    wavelength = text.sole("wavelength")
    ordered = [c.name for c in (*direction_columns(text).values(), *([wavelength] if wavelength else []))]
    used = [*ordered, *(n for names in values.names.values() for n in names)]
    numbers = text.numbers(used, values.names["f"] + values.names.get("u_f", []))
    directions = read_angles(text, statements, numbers, angles, mirror_azimuth)
    values = values._replace(coverage=coverage)
    readings = read_values(text, statements, values, numbers, None if missing is None else str(missing))
    readings, channels = _of_quantity(readings, directions, values.quantity), values.channels
    understood = [*directions.understood, *values.understood]
    if wavelength:
        unit = wavelength.unit if wavelength.unit in LENGTHS_NM else ""
        every = np.stack(directions.angles)
        nm, rows, readings = by_wavelength(text, wavelength.name, unit, numbers[wavelength.name], every, readings)
        directions = directions._replace(angles=tuple(every[:, rows]))
        channels = Channels.of_wavelengths(nm)
        understood.append(_of_wavelengths(wavelength.name, nm))
    provenance = {
        "format": "CSV",
        "source": os.path.basename(path),
        "angles": directions.unit,
        "quantity": values.quantity + ("" if values.quantity_known else " (not stated)"),
        "ignored_columns": [n for n in dict.fromkeys(text.names) if n and n not in numbers][:100],
    }
    table = table_of_rows(directions.angles, readings, channels, _placement(statements, directions), understood)
    table.name = stem(path)
    media = {} if media_of(stated := statements.json(MEDIA), len(channels)) is None else {MEDIA: stated}
    table.provenance |= provenance | media | {"understood": [*text.understood, *understood]}
    warnings = [*table.provenance.get("warnings", []), *(cut_off(text) or ends_early([numbers[n] for n in ordered]))]
    if not statements.by_gonio:
        warnings += suspicions(table, not directions.unit_known, not values.quantity_known)
    table.provenance |= {"warnings": warnings} if warnings else {}
    return table


def _of_wavelengths(column: str, nm: np.ndarray) -> str:
    return f"{column[:40]} has {nm.size} wavelengths, {nm[0]:g} to {nm[-1]:g} nm: one channel each"


def _of_quantity(readings: Readings, directions: Directions, quantity: str) -> Readings:
    """The readings as f, those below the horizon flagged so."""
    if directions.below is not None:
        readings.flag[directions.below] = Flag.BELOW_HORIZON
    cosines = np.abs(np.cos(directions.angles[0])), np.abs(np.cos(directions.angles[2]))
    f, u_f = (None if v is None else brdf_of(v, quantity, *cosines) for v in (readings.f, readings.u_f))
    return readings._replace(f=f, u_f=u_f)


def _placement(statements: Statements, directions: Directions) -> Placement | None:
    """The grid that the rows are: the one that gonio's own file names, else the one that their directions make."""
    stated = statements.layout()
    if stated is not None:
        cells = np.flatnonzero(stated.readable())
        if cells.size == directions.angles[0].size:
            off = [np.abs(np.sin((a[cells] - b) / 2)) for a, b in zip(stated.angles(), directions.angles, strict=True)]
            if max(o.max() for o in off) <= SAME_DIRECTION:
                return Placement(stated, cells, np.arange(stated.size))
    if statements.scattered:
        return None
    return recognised(directions.angles, directions.rounding, directions.below is not None)


class ListedDirections(NamedTuple):
    """The directions of a CSV file: components of shape (n,), and the file's own columns of them by name."""

    wi: "Direction"
    wo: "Direction"
    columns: dict[str, np.ndarray]


def read_directions(path: str | os.PathLike[str], angles: str | None = None) -> ListedDirections:
    """The directions of a CSV file; its columns can be written back with values added.

    `angles` as in `read_csv`. Raises GonioError, with the line, for what is no direction.
    """
    from gonio.models.geometry.directions import Direction, from_spherical

    text = CsvText(path)
    columns = {c.name: role for role, c in direction_columns(text).items()}
    numbers = text.numbers(columns)
    theta_i, phi_i, theta_o, phi_o = read_angles(text, Statements(text.path, text.comments), numbers, angles).angles
    if set(columns.values()) == set(VECTORS):
        components = np.stack([numbers[n] for role in VECTORS for n in columns if columns[n] == role])
        wi, wo = (Direction(*_lengthened(w)) for w in (components[:3], components[3:]))
    else:
        wi, wo = from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
    return ListedDirections(wi, wo, {n: numbers[n] for n in text.names if n in numbers})


def read_seconds(path: str | os.PathLike[str]) -> np.ndarray | None:
    """The counting times of a CSV file's rows, its column `seconds`; None where it has none."""
    text = CsvText(path)
    names = [n for n in text.names if n.strip().lower() == "seconds"][:1]
    seconds = text.numbers(names)[names[0]] if names else None
    if seconds is not None and not (seconds > 0).all():
        text.fail(int(np.argmin(seconds > 0)), f"seconds is {seconds.min():g}; give counting times above 0")
    return seconds


def write_csv(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes the cells of a table that can be read, and returns what reading them again shows to be lost.

    Angles in degrees; every number so that reading it gives the same float. Flags are written where a channel
    of a row has no value. Raises GonioError where `path` cannot be written, or no cell is valid.
    """
    comments = [
        "gonio: angles in degrees, f in 1/sr without the cosine",
        f"channels: {json.dumps(list(table.channels.names))}",
        *([f"wavelengths_nm: {json.dumps(w)}"] if (w := table.channels.wavelengths_nm) else []),
        *([f"{MEDIA}: {json.dumps(m)}"] if (m := table.provenance.get(MEDIA)) else []),
        f"layout: {json.dumps(_named_layout(table.layout))}",
    ]
    cells = written_cells(table)
    angles = [a[cells] for a in table.layout.angles()]
    stored = table.values_at(cells)
    f, u_f, flag = (stored[name] for name in ("f", "u_f", "flag"))
    valid = flag == Flag.VALID
    if not valid.any():
        raise GonioError(f"the table holds no valid reading; there is nothing to write to {path}")
    values = {"f": np.where(valid, f.astype(np.float64), np.nan)}
    if not np.isnan(u_f).all():
        values["u_f"] = u_f.astype(np.float64)
    if not valid.all():
        values["flag"] = flag
    columns = {name: rounded_degrees(a) for name, a in zip(ANGLES, angles, strict=True)}
    for name, value in values.items():
        columns |= dict(zip(value_names(table.channels, name), value.T, strict=True))
    with new_file(path, force) as temporary:
        with temporary.open("w", encoding="utf-8") as file:
            write_columns(file, columns, comments)
        again = read_csv(temporary)
        written = again.values_at(cells) if again.layout.gridded else again.read_values()
    omitted = table.layout.size - f.shape[0]
    note = f"{omitted} cells below the horizon left out" if omitted else ""
    return compare(f, written["f"], valid, written["flag"] == Flag.VALID, note)


def written_cells(table: Table) -> np.ndarray:
    """The cells that can be read; of a list not what a warp has carried below the horizon, by its flags."""
    readable = table.layout.readable()
    if not table.layout.gridded and table.layout.sides != FRONT:
        for start, stop in table.blocks():
            below = (table.read_values(start, stop)["flag"] == Flag.BELOW_HORIZON).all(axis=1)
            readable[start:stop] &= ~(below & (np.minimum(*table.layout.cosines(start, stop)) < 0))
    return np.flatnonzero(readable)


def _named_layout(layout: Layout) -> dict[str, object]:
    """A layout as JSON; axes in radians, which read again are the same."""
    axes = {name: axis.tolist() for name, axis in layout.axes.items()} if layout.gridded else {}
    return {"name": layout.name, "axes": axes}


def _lengthened(w: np.ndarray) -> np.ndarray:
    # Vectors of single precision are taken as they came: a narrow lobe would see their directions change.
    length = np.linalg.norm(w, axis=0)
    return w / np.where(np.abs(length - 1.0) <= 1e-6, 1.0, length)


def rounded_degrees(radians: np.ndarray) -> np.ndarray:
    """Degrees that give back these radians: the rounded number a person would write, where that does."""
    degrees = np.degrees(radians)
    rounded = np.round(degrees, 10)
    return np.where(np.radians(rounded) == radians, rounded, degrees)
