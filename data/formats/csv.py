"""Plain CSV: what `gonio eval` writes, read as a scattered table.

Columns by name, in any order: theta_i, phi_i, theta_o, phi_o in degrees, or wi_x, wi_y, wi_z, wo_x, wo_y,
wo_z; `f`, or `f_1`, `f_2`, ... for channels, in 1/sr without the cosine; optionally `u_f` (or `u_f_1`, ...),
the standard uncertainty (nan: unknown, 0: exact), and `flag` (or `flag_1`, ...).
"""

import contextlib
import json
import os
import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import new_file, stem
from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.formats.csv_columns import CsvText, write_columns
from gonio.data.layouts import spherical_angles
from gonio.data.round_trip import RoundTrip, compare
from gonio.data.table import Table
from gonio.models.errors import GonioError

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction

ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o")
VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
UNIT_TOLERANCE = 1e-3
"""A vector whose length is off by more is no direction; a smaller error is divided out."""


def read_csv(path: str | os.PathLike[str]) -> Table:
    """The scattered table of a CSV file. Raises GonioError, with the line, for whatever is no reading.

    Directions below the horizon are refused, readings on it have no value (BELOW_HORIZON); columns that mean
    nothing here are named in the provenance.
    """
    text = CsvText(path)
    names = {name: _numbered(text.names, name) for name in ("f", "u_f", "flag")}
    if not names["f"]:
        raise GonioError(
            f"{path} has no column f (or f_1, f_2, ...) but {', '.join(text.names)[:200]}; name the BRDF's column f"
        )
    for name, columns in names.items():
        if columns and [c.removeprefix(name) for c in columns] != [c.removeprefix("f") for c in names["f"]]:
            raise GonioError(
                f"{path} has {', '.join(columns)} beside {', '.join(names['f'])}; give one for each channel"
            )
    directions = _direction_names(text)
    numbers = text.numbers([*directions, *(c for columns in names.values() for c in columns)], nan_allowed=names["u_f"])
    layout = layouts.scattered(*_angles(text, numbers, directions))
    f, u_f, flag = (np.stack([numbers[c] for c in columns], -1) if columns else None for columns in names.values())
    assert f is not None
    if u_f is not None and (u_f < 0).any():
        text.fail(np.argwhere(u_f < 0)[0, 0], "u_f is negative; expected a standard uncertainty, 0 or nan")
    flag = np.zeros(f.shape) if flag is None else flag
    if (unknown := ~np.isin(flag, [int(v) for v in Flag])).any():
        meanings = ", ".join(FLAG_MEANINGS)
        text.fail(np.argwhere(unknown)[0, 0], f"a flag is none of 0 to {len(Flag) - 1} ({meanings})")
    flag = flag.astype(np.uint8)
    flag[~layout.above_horizon()] = Flag.BELOW_HORIZON
    f[flag != Flag.VALID] = np.nan
    ignored = [n for n in text.names if n not in numbers]
    provenance = {"format": "CSV", "source": os.path.basename(path), "ignored_columns": ignored}
    return Table(layout, f, flag, _channels(text, f.shape[1]), u_f, provenance=provenance, name=stem(path))


class ListedDirections(NamedTuple):
    """The directions of a CSV file: components of shape (n,), and the file's own columns of them by name."""

    wi: "Direction"
    wo: "Direction"
    columns: dict[str, np.ndarray]


def read_directions(path: str | os.PathLike[str]) -> ListedDirections:
    """The directions of a CSV file; its columns, degrees or components, can be written back with values added.

    Raises GonioError, with the line, for what is no direction or below the horizon.
    """
    from gonio.models.geometry.directions import Direction, from_spherical

    text = CsvText(path)
    names = _direction_names(text)
    columns = text.numbers(names)
    angles = _angles(text, columns, names)
    if names == VECTORS:
        components = np.stack([columns[name] for name in VECTORS])
        wi, wo = (Direction(*_lengthened(w)) for w in (components[:3], components[3:]))
    else:
        wi, wo = from_spherical(angles[0], angles[1], np), from_spherical(angles[2], angles[3], np)
    return ListedDirections(wi, wo, {n: columns[n] for n in text.names if n in columns})


def write_csv(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes the cells of a table that are valid in any channel, and returns what reading them again shows to be lost.

    Angles in degrees; every number so that reading it gives the same float. Flags are written where a channel
    of a row has no value. Raises GonioError where `path` cannot be written, or no cell is valid.
    """
    comments = [
        "gonio: angles in degrees, f in 1/sr without the cosine",
        f"channels: {json.dumps(list(table.channels.names))}",
        *([f"wavelengths_nm: {json.dumps(w)}"] if (w := table.channels.wavelengths_nm) else []),
    ]
    cells = table.valid_cells()
    angles = [a[cells] for a in table.layout.angles()]
    f, u_f, flag = table.values_at(cells).values()
    if cells.size == 0:
        raise GonioError(f"the table holds no valid reading; there is nothing to write to {path}")
    valid = flag == Flag.VALID
    values = {"f": np.where(valid, f.astype(np.float64), 0.0)}
    if not np.isnan(u_f).all():
        values["u_f"] = u_f.astype(np.float64)
    if not valid.all():
        values["flag"] = flag
    columns = {name: _degrees(a) for name, a in zip(ANGLES, angles, strict=True)}
    for name, value in values.items():
        columns |= {f"{name}_{k + 1}" if len(table.channels) > 1 else name: v for k, v in enumerate(value.T)}
    with new_file(path, force) as temporary:
        with temporary.open("w", encoding="utf-8") as file:
            write_columns(file, columns, comments)
        written = read_csv(temporary).read_values()
    omitted = table.layout.size - f.shape[0]
    note = f"{omitted} cells without a value left out" if omitted else ""
    return compare(f, written["f"], valid, written["flag"] == Flag.VALID, note)


def _numbered(names: list[str], stem: str) -> list[str]:
    """[stem], or [stem_1, stem_2, ...] in the order of their numbers."""
    if stem in names:
        return [stem]
    by_number = {int(m[1]): n for n in names if (m := re.fullmatch(rf"{stem}_(\d{{1,6}})", n))}
    return [by_number[k] for k in sorted(by_number)]


def _direction_names(text: CsvText) -> tuple[str, ...]:
    for names in (VECTORS, ANGLES):
        if set(names) <= set(text.names):
            return names
    missing = [n for n in ANGLES if n not in text.names]
    raise GonioError(
        f"{text.path} has the columns {', '.join(text.names)[:200]}, but not {', '.join(missing)}; "
        f"expected {', '.join(ANGLES)} in degrees, or {', '.join(VECTORS)}"
    )


def _angles(text: CsvText, numbers: dict[str, np.ndarray], names: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """(theta_i, phi_i, theta_o, phi_o), radians, of the columns; refuses what is no direction or below the horizon."""
    if names == VECTORS:
        angles = []
        for which in ("wi", "wo"):
            x, y, z = (numbers[f"{which}_{c}"] for c in "xyz")
            off = np.abs(np.sqrt(x**2 + y**2 + z**2) - 1.0)
            if (off > UNIT_TOLERANCE).any():
                text.fail(int(np.argmax(off > UNIT_TOLERANCE)), f"{which} is no unit vector; divide it by its length")
            if (z < 0).any():
                text.fail(int(np.argmax(z < 0)), f"{which} points below the horizon; expected {which}_z >= 0")
            angles += spherical_angles(x, y, z)
        return tuple(angles)
    for name in ANGLES:
        degrees = numbers[name]
        if name.startswith("theta"):
            outside, expected = (degrees < 0) | (degrees > 90), "0 to 90 degrees from the normal"
        else:
            outside, expected = np.abs(degrees) > 360, "-360 to 360 degrees"
        if outside.any():
            row = int(np.argmax(outside))
            below = " is below the horizon" if name.startswith("theta") and degrees[row] > 90 else ""
            text.fail(row, f"{name} = {degrees[row]:g}{below}; expected {expected}")
    theta_i, phi_i, theta_o, phi_o = (np.radians(numbers[name]) for name in ANGLES)
    return theta_i, phi_i % (2 * np.pi), theta_o, phi_o % (2 * np.pi)


def _lengthened(w: np.ndarray) -> np.ndarray:
    # Vectors of single precision are taken as they came: a narrow lobe would see their directions change.
    length = np.linalg.norm(w, axis=0)
    return w / np.where(np.abs(length - 1.0) <= 1e-6, 1.0, length)


def _channels(text: CsvText, count: int) -> Channels:
    stated = {}
    for comment in text.comments:
        key, _, value = comment.partition(":")
        if key in ("channels", "wavelengths_nm"):
            with contextlib.suppress(ValueError, RecursionError):  # ValueError: no JSON, or too many digits
                stated[key] = json.loads(value)

    def listed(key: str, kind: Any) -> tuple | None:
        values = stated.get(key)
        fits = isinstance(values, list) and len(values) == count and all(isinstance(v, kind) for v in values)
        return tuple(values) if isinstance(values, list) and fits else None

    names = listed("channels", str)
    return Channels.of_count(count) if names is None else Channels(names, listed("wavelengths_nm", int | float))


def _degrees(radians: np.ndarray) -> np.ndarray:
    """Degrees that give back these radians: the rounded number a person would write, where that does."""
    degrees = np.degrees(radians)
    rounded = np.round(degrees, 10)
    return np.where(np.radians(rounded) == radians, rounded, degrees)
