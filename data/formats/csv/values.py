"""The values of a CSV file: which columns hold f, its uncertainty and its flags, and of which channels."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.channels import Channels
from gonio.data.formats.csv.columns import CsvText
from gonio.data.formats.csv.header import LENGTHS_NM, NO_UNIT, PER_STERADIAN, Column, shown, sole
from gonio.data.formats.csv.statements import Statements

SHARES = ("reflectance_factor", "i_over_f")
"""Quantities without a unit, which may stand in per cent."""


class ValueColumns(NamedTuple):
    """The columns of values, one for each channel."""

    f: list[Column]
    u_f: list[Column] | None
    flag: list[Column] | None
    channels: Channels
    quantity: str
    quantity_known: bool
    """Whether the file or the caller says what f is."""
    understood: list[str]
    coverage: float | None = None
    """k of the uncertainties, where the caller states it."""

    @property
    def names(self) -> dict[str, list[str]]:
        """Names of the columns by what they hold."""
        columns = {"f": self.f, "u_f": self.u_f, "flag": self.flag}
        return {key: [c.name for c in cs] for key, cs in columns.items() if cs}


def value_columns(text: CsvText, statements: Statements, quantity: str | None) -> ValueColumns:
    """The columns of values of a file; `quantity` where the caller states it.

    Raises GonioError where columns or what they hold cannot be known.
    """
    f, channels, understood = _channels(text, statements)
    u_f, flag = (_beside(text, f, role) for role in ("u_f", "flag"))
    named = {c.quantity for c in f}
    if quantity is None and len(named) > 1:
        text.refuse(f"the columns {shown([c.name for c in f])} hold several quantities; keep one kind")
    header, comment = next(iter(named)), None if statements.by_gonio or quantity else statements.quantity()
    if quantity is None and header and comment not in (None, header):
        text.refuse(f"{f[0].name[:40]!r} and a comment name two quantities; state --quantity {header} or {comment}")
    kind = quantity or header or comment or "brdf"
    who = (
        "stated by the caller"
        if quantity
        else "the header says so"
        if header
        else "a comment says so"
        if comment
        else ""
    )
    if who and kind != "brdf":
        understood.append(f"values are {kind} ({who})")
    names = [c.name for c in f]
    if names[0] != "f" and not all(n.startswith("f_") for n in names):
        understood.append(f"f is in {shown(names, 60)}")
    known = quantity is not None or statements.by_gonio or (header or comment) not in (None, "brdf")
    return ValueColumns(f, u_f, flag, channels, kind, known, understood)


def scales(text: CsvText, values: ValueColumns) -> tuple[np.ndarray, np.ndarray | None]:
    """(factor of the values of each column of f, share of f that one unit of each column of u_f is, or None).

    Raises GonioError, naming the column, for a unit that is not known.
    """
    factors = []
    for c in values.f:
        if c.unit == "%" and values.quantity in SHARES:
            factors.append(0.01)
        elif c.unit in PER_STERADIAN | NO_UNIT or c.unit in LENGTHS_NM:
            factors.append(1.0)
        else:
            text.refuse(
                f"the column {c.name[:40]!r} has the unit {c.unit[:20]!r}; expected 1/sr, or a name such as "
                "'reflectance factor [%]' that says what it is"
            )
    pairs = zip(values.u_f or [], values.f, strict=False)
    relative = [
        (0.01 if c.unit == "%" else 1.0) if c.relative or (c.unit == "%" and f.unit != "%") else 0.0 for c, f in pairs
    ]
    return np.array(factors), np.array(relative) if any(relative) else None


def wavelength_unit(numbers: Sequence[float] | np.ndarray) -> str | None:
    """nm, um or m, by the size of wavelengths of light; None where that does not decide."""
    values = np.asarray(numbers, float)
    if (values >= 100).all() and (values <= 1e5).all():
        return "nm"
    if (values >= 0.1).all() and (values <= 30).all() and (values % 1 != 0).any():
        return "um"
    return "m" if (values > 0).all() and (values < 1e-4).all() else None


def nanometres(numbers: Sequence[float] | np.ndarray, unit: str) -> np.ndarray:
    """Wavelengths in nm, without the digits that a change of unit makes."""
    return np.round(np.asarray(numbers, float) * LENGTHS_NM[unit], 6)


def _channels(text: CsvText, statements: Statements) -> tuple[list[Column], Channels, list[str]]:
    """(columns of f in the order of the channels, channels, what was understood)."""
    columns = [c for c in text.columns if c.role == "f"]
    plain = [c for c in columns if c.number is None and not c.label]
    numbered, labelled = [c for c in columns if c.number is not None], [c for c in columns if c.label]
    if not columns:
        text.refuse(
            f"it has no column f (or f_1, f_2, ..., or f_450nm, ...) but {shown(text.names)}; name the BRDF's column f"
        )
    if bool(plain) + bool(numbered) + bool(labelled) > 1:
        text.refuse(
            f"it has {shown([(plain or labelled)[0].name, (numbered or labelled)[0].name])} side by side; keep "
            "one column f, or one for each channel"
        )
    if numbered:
        return _numbered(text, statements, numbered)
    if labelled:
        order = {label: k for k, label in enumerate("RGBXYZ")}
        labelled.sort(key=lambda c: order[c.label])
        return labelled, Channels(tuple(c.label for c in labelled)), []
    f = text.sole("f")
    assert f is not None
    return [f], _stated_channels(text, statements, 1) or Channels.grey(), []


def _numbered(text: CsvText, statements: Statements, columns: list[Column]) -> tuple[list[Column], Channels, list[str]]:
    """Channels counted from 0 or 1, or wavelengths."""
    columns = sorted(columns, key=lambda c: c.number or 0.0)
    numbers = [c.number or 0.0 for c in columns]
    names = [c.name for c in columns]
    units = {_length(c) for c in columns} - {""}
    counted = numbers in ([float(k) for k in range(len(numbers))], [float(k + 1) for k in range(len(numbers))])
    if counted and not units:
        return columns, _stated_channels(text, statements, len(columns)) or Channels.of_count(len(columns)), []
    unit = next(iter(units), None) if len(units) <= 1 else None
    unit = unit or (wavelength_unit(numbers) if not units else None)
    every = [_length(c) or unit for c in columns]
    if None in every:
        text.refuse(
            f"the columns {shown(names, 60)} may be channels or wavelengths; number channels from 1, or write the "
            "unit, as in f_450nm"
        )
    nm = np.array([nanometres([n], u or "nm")[0] for n, u in zip(numbers, every, strict=True)])
    order = np.argsort(nm)
    nm, columns = nm[order], [columns[k] for k in order]
    if (np.diff(nm) == 0).any():
        text.refuse(f"it has the wavelength {nm[:-1][np.diff(nm) == 0][0]:g} nm twice; remove one column")
    if nm[0] <= 0:
        text.refuse(f"{columns[0].name[:40]!r} is no wavelength; write one above 0, or number channels from 1")
    who = "the header says the unit" if units else "the unit is taken by their size"
    what = f"columns {shown(names, 60)} are wavelengths in {' and '.join(sorted(units)) or unit} ({who})"
    return columns, Channels.of_wavelengths(nm), [what]


def _length(column: Column) -> str:
    """The unit of the wavelength of a column; empty where none is written."""
    return column.length or (column.unit if column.unit in LENGTHS_NM else "")


def _stated_channels(text: CsvText, statements: Statements, count: int) -> Channels | None:
    """The channels that comments list. Raises GonioError where a list of wavelengths has another length."""
    names, wavelengths = statements.json("channels"), statements.wavelengths_nm()
    if wavelengths is not None and len(wavelengths) != count:
        text.refuse(f"it lists {len(wavelengths)} wavelengths, but has {count} columns of f; list one each")
    if isinstance(names, list) and len(names) == count and all(isinstance(n, str) for n in names):
        return Channels(tuple(names), None if wavelengths is None else tuple(wavelengths))
    return None if wavelengths is None else Channels.of_wavelengths(wavelengths)


def _beside(text: CsvText, f: list[Column], role: str) -> list[Column] | None:
    """The columns of another role, one for each of f; None where there is none."""
    others = [c for c in text.columns if c.role == role]
    if not others:
        return None
    by_channel: dict[tuple[float | None, str], list[Column]] = {}
    for c in others:
        by_channel.setdefault((c.number, c.label), []).append(c)
    matched = [by_channel.get((c.number, c.label), []) for c in f]
    if not any(matched):  # one column for all channels
        matched = [by_channel.get((None, ""), [])] * len(f)
        others = others * len(f)
    if not all(matched) or sum(map(len, matched)) != len(others):
        listed = shown([c.name for c in others], 60)
        text.refuse(f"it has {listed} beside {shown([c.name for c in f], 60)}; give one for each channel")
    return [m[0] if len(m) == 1 else sole(m, role) or m[0] for m in matched]
