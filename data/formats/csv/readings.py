"""The readings of a CSV file: values with their missing cells, uncertainties and flags, by rows or by wavelengths."""

from typing import NamedTuple

import numpy as np

from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.formats.csv.columns import CsvText
from gonio.data.formats.csv.conventions import coverage_factor
from gonio.data.formats.csv.statements import Statements
from gonio.data.formats.csv.values import ValueColumns, nanometres, scales, wavelength_unit
from gonio.data.layouts.recognition import Placement
from gonio.models.errors import GonioError

FILLS = (1e20, 1e30, 1e36, 9.969209968386869e36, float(np.finfo(np.float32).max), float(np.finfo(np.float64).max))
"""What programs write where nothing was read, besides nines."""
MOST_REPEATS = 0.3
"""Share of rows that may repeat a cell and are averaged: of more, repeats are the noise's own measurement."""
LARGE_SPREAD = 0.05
"""Share of the mean by which repeats differ in the median, without a stated uncertainty, that is no usual noise."""
LARGE_EXCESS = 9.0
"""Variance over the stated one that repeats of one quantity hardly have in the median."""
MOST_SPREAD = 50
"""Cells for each row, at most, of a file with a row for each wavelength."""


class Readings(NamedTuple):
    """Values of shape (rows, channels) as a table has them."""

    f: np.ndarray
    u_f: np.ndarray | None
    flag: np.ndarray

    def part(self, rows: np.ndarray) -> "Readings":
        """Those of these rows, in this order."""
        return Readings(self.f[rows], None if self.u_f is None else self.u_f[rows], self.flag[rows])


def read_values(
    text: CsvText, statements: Statements, values: ValueColumns, numbers: dict[str, np.ndarray], missing: str | None
) -> Readings:
    """The stored values of all rows, of the quantity that the file holds; missing ones are flagged NOT_MEASURED.

    Args:
        text, statements, values: the file, its comments and its columns.
        numbers: its columns of numbers by name.
        missing: the number that stands for no reading, or "none"; None: what a comment says, else numbers that look
            like one are refused.

    Raises:
        GonioError: with the line, for what is no reading.
    """
    f, u_f, flag = (
        np.stack([numbers[name] for name in values.names[key]], -1) if key in values.names else None
        for key in ("f", "u_f", "flag")
    )
    assert f is not None
    none = _missing_number(text, statements, values, f, missing)
    if none is not None:
        text.understood.append(f"{none:g} stands for no reading")
        f = np.where(np.isclose(f, none, rtol=1e-9, atol=0), np.nan, f)
        u_f = None if u_f is None else np.where(np.isclose(u_f, none, rtol=1e-9, atol=0), np.nan, u_f)
    f, u_f = _scaled(text, statements, values, f, u_f)
    flag = np.zeros(f.shape) if flag is None else flag
    if (unknown := ~np.isin(flag, [int(v) for v in Flag])).any():
        meanings = ", ".join(FLAG_MEANINGS)
        text.fail(np.argwhere(unknown)[0, 0], f"a flag is none of 0 to {len(Flag) - 1} ({meanings})")
    flag = flag.astype(np.uint8)
    flag[np.isnan(f) & (flag == Flag.VALID)] = Flag.NOT_MEASURED
    return Readings(f, u_f, flag)


def _scaled(
    text: CsvText, statements: Statements, values: ValueColumns, f: np.ndarray, u_f: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """Values and standard uncertainties without per cent, and without the factor of expanded ones."""
    factors, relative = scales(text, values)
    if u_f is None:
        return f * factors, None
    if (u_f < 0).any():
        text.fail(np.argwhere(u_f < 0)[0, 0], "u_f is negative; expected a standard uncertainty, 0 or nan")
    k = _coverage(values, statements)
    if k != 1:
        text.understood.append(f"uncertainties are expanded by k = {k:g}, and divided by it")
    elif not statements.by_gonio and values.coverage is None:
        text.understood.append("uncertainties are taken as standard ones (k = 1): else state --coverage")
    if relative is not None:
        text.understood.append(
            "uncertainties are in per cent of f" if relative.max() < 1 else "uncertainties are shares"
        )
    elif any(c.unit == "%" for c in values.u_f or []):
        text.understood.append(
            "uncertainties are in per cent as the values are, not of them (a header may say relative)"
        )
    scale = factors if relative is None else np.where(relative > 0, np.abs(f * factors) * relative, factors)
    return f * factors, u_f / k * scale


def by_wavelength(
    text: CsvText, column: str, unit: str, wavelengths: np.ndarray, angles: np.ndarray, rows: Readings
) -> tuple[np.ndarray, np.ndarray, Readings]:
    """(wavelengths in nm, first row of each geometry, readings) of a file with one row for each wavelength.

    A geometry that was not read at a wavelength is NOT_MEASURED there. Raises GonioError for an unknown unit.
    """
    unit = unit or wavelength_unit(wavelengths) or ""
    if not unit or (wavelengths <= 0).any():
        text.refuse(f"the column {column[:40]!r} may be nm, um or m; write the unit in its name, as in 'lambda [nm]'")
    if rows.f.shape[1] > 1:
        text.refuse(f"it has the column {column[:40]!r} beside several columns of f; keep one")
    nm, channel = np.unique(nanometres(wavelengths, unit), return_inverse=True)
    spread = by_channel(channel, nm.size, angles, rows)
    if spread is None:
        text.refuse(f"it has {nm.size} wavelengths, few of them at most of its geometries; split it by wavelength")
    return nm, *spread


def by_channel(
    channel: np.ndarray, count: int, angles: np.ndarray, rows: Readings
) -> tuple[np.ndarray, Readings] | None:
    """(first row of each geometry, readings) of rows that hold one channel each.

    Args:
        channel: number of each row's channel, (n,).
        count: channels.
        angles: of each row, (k, n); rows with the same ones are one geometry.
        rows: readings of one channel, (n, 1).

    Returns:
        A geometry that was not read in a channel is NOT_MEASURED there, one that was read several times stands
        several times. None where most of that would be empty.
    """
    geometry = np.unique(angles, axis=1, return_inverse=True)[1].reshape(-1)
    order = np.lexsort((channel, geometry))
    same = (np.diff(geometry[order]) == 0) & (np.diff(channel[order]) == 0)
    starts = np.flatnonzero(np.concatenate([[True], ~same]))
    repeat = np.empty(channel.size, np.intp)
    repeat[order] = np.arange(channel.size) - np.repeat(starts, np.diff(starts, append=channel.size))
    _, first, place = np.unique(np.stack([geometry, repeat]), axis=1, return_index=True, return_inverse=True)
    if first.size * count > MOST_SPREAD * channel.size:
        return None
    rank = np.argsort(np.argsort(first))
    shape = first.size, count
    f, flag = np.full(shape, np.nan), np.full(shape, np.uint8(Flag.NOT_MEASURED))
    cells = rank[place.reshape(-1)], channel.reshape(-1)
    f[cells], flag[cells] = rows.f[:, 0], rows.flag[:, 0]
    u_f = None
    if rows.u_f is not None:
        u_f = np.full(shape, np.nan)
        u_f[cells] = rows.u_f[:, 0]
    return np.sort(first), Readings(f, u_f, flag)


class Repeats(NamedTuple):
    """Rows whose direction an earlier row has too."""

    rows: int
    spread: np.ndarray
    """Of each direction and channel read again with other values: standard deviation over the size of the mean."""
    excess: np.ndarray
    """Their variance over the mean square of the stated uncertainties; NaN where none is stated."""

    def sentence(self) -> str:
        """What became of them, and how far apart they are."""
        apart = f"{100 * float(np.median(self.spread)):.2g} % in the median" if self.spread.size else "nothing"
        return f"{self.rows} rows repeat a direction of another and differ by {apart}; their means are taken"

    def warnings(self) -> list[str]:
        """Whether they contradict each other: by far more than is stated, or than a reading repeats."""
        known = self.excess[np.isfinite(self.excess)]
        if not self.spread.size:
            return []
        within = np.median(known) <= LARGE_EXCESS if known.size else np.median(self.spread) <= LARGE_SPREAD
        if within:
            return []
        stated = f", {float(np.median(known)) ** 0.5:.2g} times what is stated" if known.size else ""
        return [
            f"directions that are read again differ by {100 * float(np.median(self.spread)):.2g} % in the median"
            f"{stated}, and the means hide it: leave out the rows that do not belong, or correct them"
        ]


def on_grid(placed: Placement, rows: Readings) -> tuple[Readings, Repeats | None] | None:
    """(readings of all cells, rows that were averaged); None where too many rows are repeats."""
    size, channels = placed.layout.size, rows.f.shape[1]
    counts = np.bincount(placed.cells, minlength=size)
    repeats = int((counts - 1)[counts > 1].sum())
    if repeats > MOST_REPEATS * placed.cells.size:
        return None
    cells, first = np.unique(placed.cells, return_index=True)
    f, flag = np.full((size, channels), np.nan), np.full((size, channels), np.uint8(Flag.NOT_MEASURED))
    u_f = None if rows.u_f is None else np.full((size, channels), np.nan)
    grid = Readings(f, u_f, flag)
    for array, values in zip(grid, rows, strict=True):
        if array is not None and values is not None:
            array[cells] = values[first]
    averaged = None
    if repeats:
        apart = _average(grid, placed.cells, rows, np.flatnonzero(counts > 1))
        averaged = Repeats(repeats, apart[:, 0], apart[:, 1])
    return grid.part(placed.origins), averaged


def _average(grid: Readings, cells: np.ndarray, rows: Readings, repeated: np.ndarray) -> np.ndarray:
    """Puts the mean of the valid readings into each cell that several rows have.

    Returns (n, 2): spread and excess, as `Repeats` has them.
    """
    apart = []
    order = np.argsort(cells, kind="stable")
    starts, stops = (np.searchsorted(cells[order], repeated, side=s) for s in ("left", "right"))
    for cell, start, stop in zip(repeated, starts, stops, strict=True):
        those = rows.part(order[start:stop])
        for c in np.flatnonzero((those.flag == Flag.VALID).any(0)):
            valid = those.flag[:, c] == Flag.VALID
            f, stated = those.f[valid, c], np.nan
            # One reading written twice, as azimuth 0 and 360 often are, is no second one.
            same = (f == f[0]).all()
            grid.f[cell, c], grid.flag[cell, c] = f[0] if same else f.mean(), Flag.VALID
            if grid.u_f is not None and those.u_f is not None:
                u = those.u_f[valid, c]
                grid.u_f[cell, c] = u[0] if same else np.sqrt(np.sum(u**2)) / u.size
                stated = float(np.mean(u**2))
            if not same:
                variance = float(np.var(f, ddof=1))
                size = max(abs(float(f.mean())), float(np.finfo(float).tiny))
                apart.append((variance**0.5 / size, variance / stated if stated > 0 else np.nan))
    return np.array(apart).reshape(-1, 2)


def _missing_number(
    text: CsvText, statements: Statements, values: ValueColumns, f: np.ndarray, stated: str | None
) -> float | None:
    """The number that stands for no reading. Raises GonioError where one looks like it and nobody says so."""
    if stated is not None:
        try:
            return None if stated.lower() == "none" else float(stated)
        except ValueError:
            raise GonioError(f"missing={stated[:40]!r} is no number; give it, or none") from None
    if (named := statements.missing_value()) is not None or statements.by_gonio:
        return named
    suspects = _suspects(f)
    if suspects.any():
        row, column = np.argwhere(suspects)[0]
        number = f[row, column]
        times = int((f == number).sum())
        what = f"{values.f[column].name[:40]} is {number:g}, {times} times in all; if that means no reading"
        text.fail(int(row), f"{what}, state --missing {number:g}, else --missing none")
    return None


def _suspects(f: np.ndarray) -> np.ndarray:
    """Where values are such as stand for no reading: nines, fills, or -1 again and again beside positive values."""
    size = np.abs(f)
    decimals = np.where(size < 1e9, size, 0.0) * 100 % 100
    nines = np.zeros(f.shape, bool)
    for digits in range(2, 10):
        whole = 10.0**digits - 1
        stands = (size == whole) | (np.abs(size - whole) < 1) & (np.abs(decimals - 99) < 1e-6) | (size == whole + 0.9)
        nines |= stands & ((f < 0) | (digits > 2) & ((f == whole).sum() > 1))
    nines |= (f == -999.25) | np.isin(size, FILLS)
    minus_one = f == -1
    if minus_one.sum() > 1 and not ((f < 0) & ~minus_one).any():
        nines |= minus_one
    return nines


def _coverage(values: ValueColumns, statements: Statements) -> float:
    """k of the stored uncertainties: as stated, by a header such as ``U_f (k=2)``, or by a comment."""
    if values.coverage is not None:
        return coverage_factor(values.coverage)
    units, named = {c.unit for c in values.u_f or []}, [c.coverage for c in values.u_f or [] if c.coverage]
    if named:
        return max(1.0, named[0])
    written = [float(u[2:]) for u in units if u.startswith("k=") and u[2:].replace(".", "", 1).isdigit()]
    return max(1.0, written[0] if written else statements.coverage_factor())
