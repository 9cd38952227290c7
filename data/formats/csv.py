"""Plain CSV: what `gonio eval` writes, read as a scattered table.

Columns by name, in any order: theta_i, phi_i, theta_o, phi_o in degrees, or wi_x, wi_y, wi_z, wo_x, wo_y,
wo_z; `f`, or `f_1`, `f_2`, ... for channels, in 1/sr without the cosine; optionally `u_f` (or `u_f_1`, ...),
the standard uncertainty (nan: unknown, 0: exact), and `flag` (or `flag_1`, ...).
"""

import json
import os
import re

import numpy as np

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.files import new_file
from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.formats.base import FileHead, Format
from gonio.data.formats.csv_columns import CsvText, write_columns
from gonio.data.layouts import spherical_angles
from gonio.data.round_trip import RoundTrip, compare
from gonio.data.table import Table
from gonio.models.errors import GonioError

ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o")
VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
UNIT_TOLERANCE = 1e-3
"""A vector whose length is off by more is no direction; a smaller error is divided out."""


def looks_like_csv(head: FileHead) -> bool:
    """Whether a header names directions."""
    return set(ANGLES) <= set(head.columns) or set(VECTORS) <= set(head.columns)


def read_csv(path: str | os.PathLike[str]) -> Table:
    """The scattered table of a CSV file. Raises GonioError, with the line, for whatever is no reading.

    Directions below the horizon are refused, readings on it have no value (BELOW_HORIZON); columns that mean
    nothing here are named in the provenance.
    """
    text = CsvText(path)
    channels = _numbered(text.names, "f")
    if not channels:
        raise GonioError(
            f"{path} has no column f (or f_1, f_2, ...) but {', '.join(text.names)[:200]}; name the BRDF's column f"
        )
    uncertainties, flags = (_numbered(text.names, name) for name in ("u_f", "flag"))
    for name, columns in (("u_f", uncertainties), ("flag", flags)):
        if columns and [c.removeprefix(name) for c in columns] != [c.removeprefix("f") for c in channels]:
            raise GonioError(f"{path} has {', '.join(columns)} beside {', '.join(channels)}; give one for each channel")
    used = _direction_names(text)
    numbers = text.numbers([*used, *channels, *uncertainties, *flags], nan_allowed=uncertainties)
    pair = _angles(text, numbers, used)
    f = np.stack([numbers[c] for c in channels], axis=-1)
    u_f = np.stack([numbers[c] for c in uncertainties], axis=-1) if uncertainties else None
    flag = np.stack([numbers[c] for c in flags], axis=-1) if flags else np.zeros(f.shape)
    if u_f is not None and (u_f < 0).any():
        text.fail(np.argwhere(u_f < 0)[0, 0], "u_f is negative; expected a standard uncertainty, 0 or nan")
    if not np.isin(flag, [int(v) for v in Flag]).all():
        row = np.argwhere(~np.isin(flag, [int(v) for v in Flag]))[0, 0]
        text.fail(row, f"a flag is none of 0 to {len(Flag) - 1} ({', '.join(FLAG_MEANINGS)})")
    grid = layouts.scattered(*pair)
    flag = flag.astype(np.uint8)
    flag[~grid.above_horizon()] = Flag.BELOW_HORIZON
    f[flag != Flag.VALID] = np.nan
    ignored = [n for n in text.names if n not in numbers]
    provenance = {"format": "CSV", "source": os.path.basename(path), "ignored_columns": ignored}
    name = os.path.splitext(os.path.basename(path))[0]
    return Table(grid, f, flag, _channels(text, len(channels)), u_f, provenance=provenance, name=name)


def read_directions(path: str | os.PathLike[str]):
    """(wi, wo, columns) of a CSV file of directions: components of shape (n,), and the file's own direction
    columns.

    `columns` maps names to float64 arrays, degrees or components as the file has them, to be written back
    with values added (`gonio.data.formats.csv_columns.write_columns`). Raises GonioError, with the line, for what is no
    direction or below the horizon.
    """
    from gonio.models.geometry.directions import Direction

    text = CsvText(path)
    used = _direction_names(text)
    columns = text.numbers(used)
    pair = _angles(text, columns, used)
    if used == VECTORS:
        parts = np.stack([columns[name] for name in VECTORS])
        wi, wo = (_lengthened(w) for w in (parts[:3], parts[3:]))
    else:
        wi, wo = (_unit_vector(theta, phi) for theta, phi in (pair[:2], pair[2:]))
    return Direction(*wi), Direction(*wo), {name: columns[name] for name in text.names if name in columns}


def write_csv(path: str | os.PathLike[str], table: Table, force: bool = False) -> RoundTrip:
    """Writes the cells of a table that are valid in any channel, and returns what reading them again shows to
    be lost.

    Angles in degrees; every number so that reading it gives the same float. Flags are written where a channel
    of a row has no value. Raises GonioError where `path` cannot be written, or no cell is valid.
    """
    names = _suffixes(len(table.channels))
    comments = [
        "gonio: angles in degrees, f in 1/sr without the cosine",
        f"channels: {json.dumps(list(table.channels.names))}",
        *([f"wavelengths_nm: {json.dumps(w)}"] if (w := table.channels.wavelengths_nm) else []),
    ]
    chosen = []
    for start, stop in table.blocks():
        values = table.read_values(start, stop)
        at = np.flatnonzero((values["flag"] == Flag.VALID).any(axis=1))
        angles = table.layout.angles(start, stop)
        chosen.append([part[at] for part in (*angles, values["f"], values["u_f"], values["flag"])])
    *angles, f, u_f, flag = (np.concatenate(parts) for parts in zip(*chosen, strict=True))
    if f.shape[0] == 0:
        raise GonioError(f"the table holds no valid reading; there is nothing to write to {path}")
    columns = {name: _degrees(a) for name, a in zip(ANGLES, angles, strict=True)}
    valid = flag == Flag.VALID
    for k, suffix in enumerate(names):
        columns[f"f{suffix}"] = np.where(valid[:, k], f[:, k].astype(np.float64), 0.0)
    if not np.isnan(u_f).all():
        columns |= {f"u_f{suffix}": u_f[:, k].astype(np.float64) for k, suffix in enumerate(names)}
    if not valid.all():
        columns |= {f"flag{suffix}": flag[:, k] for k, suffix in enumerate(names)}
    with new_file(path, force) as temporary:
        with temporary.open("w", encoding="utf-8") as file:
            write_columns(file, columns, comments)
        read = read_csv(temporary).read_values()
    left = table.layout.size - f.shape[0]
    note = f"{left} cells without a value left out" if left else ""
    return compare(f, read["f"], valid, read["flag"] == Flag.VALID, note)


def _numbered(names: list[str], stem: str) -> list[str]:
    """[stem], or [stem_1, stem_2, ...] in the order of their numbers."""
    if stem in names:
        return [stem]
    found = {int(m[1]): n for n in names if (m := re.fullmatch(rf"{stem}_(\d{{1,6}})", n))}
    return [found[k] for k in sorted(found)]


def _suffixes(count: int) -> list[str]:
    return [""] if count == 1 else [f"_{k + 1}" for k in range(count)]


def _direction_names(text: CsvText) -> tuple[str, ...]:
    for names in (VECTORS, ANGLES):
        if set(names) <= set(text.names):
            return names
    missing = [n for n in ANGLES if n not in text.names]
    raise GonioError(
        f"{text.path} has the columns {', '.join(text.names)[:200]}, but not {', '.join(missing)}; "
        f"expected {', '.join(ANGLES)} in degrees, or {', '.join(VECTORS)}"
    )


def _angles(text: CsvText, numbers, used) -> tuple[np.ndarray, ...]:
    """(theta_i, phi_i, theta_o, phi_o), radians, of the columns; refuses what is no direction or below the horizon."""
    if used == VECTORS:
        pair = []
        for which in ("wi", "wo"):
            x, y, z = (numbers[f"{which}_{c}"] for c in "xyz")
            off = np.abs(np.sqrt(x**2 + y**2 + z**2) - 1.0)
            if (off > UNIT_TOLERANCE).any():
                text.fail(int(np.argmax(off > UNIT_TOLERANCE)), f"{which} is no unit vector; divide it by its length")
            if (z < 0).any():
                text.fail(int(np.argmax(z < 0)), f"{which} points below the horizon; expected {which}_z >= 0")
            pair += spherical_angles(x, y, z)
        return tuple(pair)
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


def _unit_vector(theta, phi):
    sin_t = np.sin(theta)
    return sin_t * np.cos(phi), sin_t * np.sin(phi), np.cos(theta)


def _channels(text: CsvText, count: int) -> Channels:
    found = {}
    for comment in text.comments:
        key, _, value = comment.partition(":")
        if key in ("channels", "wavelengths_nm"):
            try:
                found[key] = json.loads(value)
            except (json.JSONDecodeError, RecursionError):
                continue
    names, wavelengths = found.get("channels"), found.get("wavelengths_nm")
    if not (isinstance(names, list) and len(names) == count and all(isinstance(n, str) for n in names)):
        return Channels.of_count(count)
    good = isinstance(wavelengths, list) and all(isinstance(w, int | float) for w in wavelengths)
    return Channels(tuple(names), tuple(wavelengths) if good and len(wavelengths) == count else None)


def _degrees(radians: np.ndarray) -> np.ndarray:
    """Degrees that give back these radians: the rounded number a person would write, where that does."""
    degrees = np.degrees(radians)
    rounded = np.round(degrees, 10)
    return np.where(np.radians(rounded) == radians, rounded, degrees)


FORMAT = Format(
    "CSV", "CSV with a header (theta_i,phi_i,theta_o,phi_o,f)", "table", looks_like_csv, read_csv, write_csv,
    suffixes=(".csv",),
)  # fmt: skip
