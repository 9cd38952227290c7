"""JSON of European metrology institutes (BiRD): schema 1.0, the rows before it, and the older form by theta_v.

A reading for each direction, wavelength and polarisation; one channel for each wavelength and polarisation.
"""

import math
import os
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.csv.conventions import Convention, convention, coverage_factor
from gonio.data.formats.csv.listed_rows import Listing, rounding_of, table_of_listing
from gonio.data.formats.csv.readings import Readings, by_channel
from gonio.data.formats.laboratory.bird_section import stored_table
from gonio.data.formats.laboratory.json_text import JsonPart, read_json
from gonio.data.table import Table
from gonio.models.errors import GonioError

KIND = "readings of BiRD"
MARKS = (b'"BRDF"', b'"theta_i"', b'"theta_r"', b'"theta_v"', b"brdf_json_schema")
DEGREES = ("deg", "°", "degree", "degrees", "")
RADIANS = ("rad", "radian", "radians")
NANOMETRES = {"nm": 1.0, "": 1.0, "μm": 1e3, "µm": 1e3, "um": 1e3, "m": 1e9}
STOKES = {(1.0, 1.0, 0.0, 0.0): "s", (1.0, -1.0, 0.0, 0.0): "p", (1.0, 0.0, 0.0, 0.0): "u"}
"""Normalised Stokes vectors by their letters."""
UNPOLARISED = ("u", "u to u")
ANGLES = ("theta_i", "phi_i", "theta_r", "phi_r")


class _Rows(NamedTuple):
    """One reading a row."""

    angles: np.ndarray
    """theta_i, phi_i, theta_o, phi_o, radians, (4, n)."""
    f: np.ndarray
    """(n,)."""
    u_f: np.ndarray | None
    wavelengths_nm: np.ndarray | None
    states: list[str] | None
    """Names of polarisations, or of channels that have no wavelength."""
    rounding: float
    understood: list[str]


def is_bird(start: bytes) -> bool:
    """Whether a file begins as such a file does."""
    return start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and any(mark in start for mark in MARKS)


def read_bird(
    path: str | os.PathLike[str],
    quantity: str | None = None,
    mirror_azimuth: float | None = None,
    coverage: float | None = None,
) -> Table:
    """The table of a file: on the grid that its rows are, else scattered. Negative readings are kept.

    Args:
        path: the file.
        quantity: what the values are (a key of `gonio.data.quantities.QUANTITIES`); the BRDF otherwise.
        mirror_azimuth: phi_r − phi_i of the mirror side, degrees: 180 or 0.
        coverage: k of the file's uncertainties; what its comments say otherwise, else 1.

    Raises:
        GonioError: damaged JSON, and lists that are missing or of other lengths.
    """
    how, file = convention(quantity, mirror_azimuth), JsonPart(path, read_json(path, KIND))
    data = file.part("data")
    if "theta_v" in data:
        rows = _older(data)
    elif "BRDF" in data:
        rows = _schema_1(data, coverage)
    elif "variables" in data:
        rows = _schema_1(_of_rows(data), coverage)
    else:
        raise GonioError(f"{path}: its data have no BRDF, no variables and no theta_v; export the file again")
    metadata = JsonPart(path, file.data.get("metadata", file.data.get("head", {})), "metadata")
    about = _about(metadata)
    table = stored_table(file, rows.f, rows.u_f, rows.angles) if how == Convention(quantity_known=False) else None
    if table is not None:
        table.name, table.provenance = about["metadata"].get("sample", ""), about | {"source": os.path.basename(path)}
        return table
    return _table(path, rows, how, about)


def _table(path: str | os.PathLike[str], rows: _Rows, how: Convention, about: dict[str, Any]) -> Table:
    channel, channels = _channels(rows)
    flag = np.where(np.isnan(rows.f), np.uint8(Flag.NOT_MEASURED), np.uint8(Flag.VALID))
    u_f = None if rows.u_f is None else rows.u_f[:, None]
    spread = by_channel(channel, len(channels), rows.angles, Readings(rows.f[:, None], u_f, flag[:, None]))
    if spread is None:
        raise GonioError(f"{path} has {len(channels)} channels, few of them at most of its geometries; split it")
    first, readings = spread
    four = rows.angles[:, first]
    about["understood"] += rows.understood
    listing = Listing(
        (four[0], four[1], four[2], four[3]), readings.f, channels, readings.u_f, readings.flag, rows.rounding
    )
    return table_of_listing(path, listing, how, about, about["metadata"].get("sample", ""))


def _schema_1(data: JsonPart, coverage: float | None) -> _Rows:
    brdf = data.part("BRDF")
    f = brdf.numbers("values")
    understood: list[str] = []
    columns, rounding = [], []
    for name in ANGLES:
        part = data.part(name)
        unit = part.text("unit").strip()
        if unit not in (*DEGREES, *RADIANS):
            raise GonioError(f"{data.path}: data.{name} has the unit {unit[:20]!r}; expected deg or rad")
        values = part.numbers("values", count=f.size)
        scale = math.pi / 180 if unit in DEGREES else 1.0
        columns.append(values * scale)
        rounding.append(rounding_of([values], scale))
    u_f = _uncertainty(data, brdf, f, coverage, understood)
    return _Rows(
        np.stack(columns), f, u_f, _wavelengths(data, f.size, understood), _states(data, f.size), max(rounding),
        [*understood, "angles are in the units that the file states"],
    )  # fmt: skip


def _wavelengths(data: JsonPart, count: int, understood: list[str]) -> np.ndarray | None:
    """Of the light, nm; else of what was detected."""
    known = [name for name in ("wavelength_i", "wavelength_r", "wavelength") if name in data]
    result = None
    for name in known:
        part = data.part(name)
        unit = part.text("unit").strip()
        if unit not in NANOMETRES:
            raise GonioError(f"{data.path}: data.{name} has the unit {unit[:20]!r}; expected nm or μm")
        nm = np.round(part.numbers("values", count=count) * NANOMETRES[unit], 6)
        if result is not None and not np.array_equal(nm, result):
            understood.append(
                f"{name} differs from {known[0]}, and is not used: light of other wavelengths was detected"
            )
        result = nm if result is None else result
    return result


def _states(data: JsonPart, count: int) -> list[str] | None:
    """The polarisations of light and detector, or the channel's own name, of each row; None where nothing says them."""
    names = [_labels(data, key, count) for key in ("polarization_i", "polarization_r")]
    adhoc = data.data.get("adhoc_variables")
    if isinstance(adhoc, dict) and isinstance(adhoc.get("channel"), dict):
        names.append([str(v)[:80] for v in JsonPart(data.path, adhoc["channel"]).entries("values")])
    known = [labels for labels in names if labels is not None]
    if any(len(labels) != count for labels in known):
        raise GonioError(f"{data.path}: its polarisations are not as many as its readings; complete the lists")
    return [" to ".join(row) for row in zip(*known, strict=True)] if known else None


def _labels(data: JsonPart, key: str, count: int) -> list[str] | None:
    if key not in data:
        return None
    part = data.part(key)
    values = part.entries("values")
    if len(values) != count:
        raise GonioError(f"{data.path}: data.{key}.values has {len(values)} entries, expected {count}")
    return [_letter(value) for value in values]


def _letter(state: Any) -> str:
    """s, p or u, where a Stokes vector is one of these; else its components."""
    if isinstance(state, list) and all(isinstance(c, float) for c in state):
        return STOKES.get(tuple(state), "(" + " ".join(f"{c:g}" for c in state[:4]) + ")")
    return str(state)[:20]


def _uncertainty(
    data: JsonPart, brdf: JsonPart, f: np.ndarray, coverage: float | None, understood: list[str]
) -> np.ndarray | None:
    """Standard uncertainties, 1/sr, of the readings; None where the file has none."""
    if "uBRDF" in data:
        part = data.part("uBRDF")
        values = part.numbers("values", count=f.size)
    elif isinstance(brdf.data.get("uncertainty"), dict):
        part = brdf.part("uncertainty")
        value = part.data.get("value")
        values = np.full(f.size, value if isinstance(value, float) else np.nan)
    else:
        return None
    unit = part.text("unit").strip()
    if unit not in ("%", "1/sr", "sr^-1", "sr⁻¹", ""):
        raise GonioError(f"{data.path}: its uncertainties have the unit {unit[:20]!r}; expected 1/sr or %")
    if (values < 0).any():
        raise GonioError(f"{data.path}: an uncertainty is negative; expected numbers from 0 up")
    k, who = _coverage(part.text("comments") or brdf.text("comments"), coverage)
    understood.append(f"uncertainties are taken as {k:g} standard ones ({who})")
    understood += ["uncertainties are in per cent of f"] if unit == "%" else []
    return values / k * (np.abs(f) / 100 if unit == "%" else 1.0)


def _coverage(comments: str, stated: float | None) -> tuple[float, str]:
    """(k of uncertainties, who says so)."""
    if stated is not None:
        return coverage_factor(stated), "stated by the caller"
    match = re.search(r"\bk\s*=\s*([1-9](?:\.\d{1,3})?)\b", comments[:2000])
    return (float(match[1]), "a comment says so") if match else (1.0, "nobody says it: --coverage does")


def _of_rows(data: JsonPart) -> JsonPart:
    """Rows of variables, as files before schema 1.0 have them, by the names of the variables."""
    rows = data.entries("values")
    columns: dict[str, Any] = {}
    for k, entry in enumerate(data.entries("variables")):
        variable = JsonPart(data.path, entry, "data.variables")
        if not all(isinstance(row, list) and len(row) > k for row in rows):
            raise GonioError(f"{data.path}: data.values has rows without a value of each variable; complete them")
        columns[variable.text("name")] = {**variable.data, "values": [row[k] for row in rows]}
    for old, name in (("wavelength", "wavelength_i"), ("polarization", "polarization_i")):
        if old in columns and name not in columns:
            columns[name] = columns.pop(old)
    return JsonPart(data.path, columns, "data")


def _older(data: JsonPart) -> _Rows:
    """A matrix of readings by wavelength and geometry; the detector's polar angle may be negative."""
    nm, f = np.round(data.numbers("wavelengths"), 6), data.numbers("data", 2)
    names = ("theta_i", "phi_i", "theta_v", "phi_v")
    degrees = np.stack([data.numbers(name, count=f.shape[1]) for name in names])
    if f.shape[0] != nm.size:
        raise GonioError(f"{data.path}: data.data has {f.shape[0]} rows for {nm.size} wavelengths; complete them")
    geometry = np.tile(np.arange(f.shape[1]), nm.size)
    states = None
    if "pol" in data:
        letters = [_letter(state) for state in data.entries("pol")]
        if len(letters) != f.shape[1]:
            raise GonioError(f"{data.path}: data.pol has {len(letters)} entries, expected {f.shape[1]}")
        states = [letters[g] for g in geometry]
    rounding = rounding_of(degrees, math.radians(1.0))
    understood = ["angles are taken as degrees, wavelengths as nm: the older form does not say their units"]
    wavelengths = np.repeat(nm, f.shape[1])
    return _Rows(np.radians(degrees)[:, geometry], f.reshape(-1), None, wavelengths, states, rounding, understood)


def _channels(rows: _Rows) -> tuple[np.ndarray, Channels]:
    """(number of each row's channel, the channels): by wavelength and state."""
    count = rows.f.size
    nm = np.zeros(count) if rows.wavelengths_nm is None else rows.wavelengths_nm
    states, numbers = _numbered(rows.states or [""] * count)
    lengths, order = np.unique(nm, return_inverse=True)
    codes, channel = np.unique(order.reshape(-1) * max(len(states), 1) + numbers, return_inverse=True)
    keys = [(float(lengths[c // len(states)]), states[c % len(states)]) for c in codes]
    if rows.wavelengths_nm is None:
        return channel.reshape(-1), Channels(tuple(state or "grey" for _, state in keys) or ("grey",))
    channels = Channels.of_wavelengths(sorted({w for w, _ in keys}))
    if len(states) > 1 or states[0] not in ("", *UNPOLARISED):
        short = dict(zip(channels.wavelengths_nm or (), channels.names, strict=True))
        channels = Channels(tuple(f"{short[w]} {state}" for w, state in keys), tuple(w for w, _ in keys))
    if len(states) == 1 and states != [""]:
        rows.understood.append(f"polarisation {states[0]}")
    return channel.reshape(-1), channels


def _numbered(names: Sequence[str]) -> tuple[list[str], np.ndarray]:
    """(the names in the order in which they come, number of each)."""
    distinct = list(dict.fromkeys(names))
    number = {name: k for k, name in enumerate(distinct)}
    return distinct, np.array([number[name] for name in names], np.intp)


def _about(metadata: JsonPart) -> dict[str, Any]:
    """The provenance that a file's metadata state."""
    stated = {k: metadata.text(k)[:400] for k in ("timestamp", "date", "description", "method", "id") if k in metadata}
    if isinstance(sample := metadata.data.get("sample"), dict):
        stated["sample"] = str(sample.get("name", ""))[:200]
    return {"format": "BiRD", "metadata": {k: v for k, v in stated.items() if v}, "understood": []}
