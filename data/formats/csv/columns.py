"""Columns of numbers out of a CSV text, with the line of whatever is wrong; and numbers into one, at full precision."""

import codecs
import csv
import functools
import io
import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np

from gonio.data.files import input_size
from gonio.data.formats.csv.header import ANGLE_UNITS, PER_STERADIAN, Column, columns_of, repeated_name, sole
from gonio.data.formats.csv.header_forms import last_row, merged_names, without_turned_rows
from gonio.models.errors import GonioError, one_line

DELIMITERS = (";", "\t", ",", "|", "")
"""Between columns; the last one stands for runs of blanks."""
MISSING = frozenset(("", "nan", "n/a", "na", "null", "none", "missing", "-", "--", "*"))
"""How a cell says that it has no value, besides being empty."""
FEWEST_NAMES = 2
"""Columns of directions by which a header is known: what is missing beside them is the reader's to say."""
PREAMBLE = 200
"""Lines of free text that may stand before the header."""
MOST_COLUMNS = 20_000
"""Names in a header; a line of more is no header."""
MINUS_SIGN = "\N{MINUS SIGN}"
"""What typesetting programs write for a hyphen before a number."""
FORTRAN_EXPONENT = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d+$)")
"""Of 1.5D+01."""
NUMBER_START = re.compile(r'"?\s*[-+]?[.,]?\d')


class CsvText:
    """A CSV file: comments, a header of column names, then rows of numbers; blank lines are ignored.

    Comments are lines that begin with '#', and what stands before the header. Columns are separated by commas,
    semicolons, tabs, bars or blanks; numbers may have decimal commas where commas do not separate. Text in UTF-8,
    UTF-16 (with its mark) or Latin-1. `limit`: only so many bytes are read, enough for the header. Raises GonioError
    where the file is absent, empty, no text or without a header.
    """

    def __init__(self, path: str | os.PathLike[str], limit: int | None = None) -> None:
        self.path = str(path)
        read = decoded(path, limit).split("\n")
        self.lines = without_turned_rows(read)
        self.comments: list[str] = []
        self.header_line = self._find_header()
        header = _uncommented(self.lines[self.header_line])
        if (width := _widest_split(header)) > MOST_COLUMNS:
            raise GonioError(
                f"{self.path} has {width:,} columns in its first line; a table has at most {MOST_COLUMNS:,}"
            )
        self.delimiter, self.columns = _best_split(header)
        self.names = [c.name for c in self.columns]
        if self.headless:
            raise GonioError(
                f"{self.path} has no header; name the columns in the first line: theta_i,phi_i,theta_o,phi_o,f"
            )
        self.understood: list[str] = []
        """How the text was taken, where that is not as gonio writes it."""
        if self.lines is not read:
            self.understood.append("columns are pairs of angles, light/detector, and rows are wavelengths")
        if repeated_name(self.names) is not None:
            self._merge_header()
        if (twice := repeated_name(self.names)) is not None:
            raise GonioError(f"{self.path} has the column {twice[:40]!r} twice; rename or remove one")
        self.first_line = self.header_line + 1
        if limit is None and self.delimiter:
            self._drop_remarks()
        self._take_units_row()

    @property
    def headless(self) -> bool:
        """Whether numbers stand where the header should be."""
        return not self.has_directions and NUMBER_START.match(self.lines[self.header_line].strip()) is not None

    @property
    def has_directions(self) -> bool:
        """Whether the header names directions, all or in part."""
        return _directions_in(self.columns) >= FEWEST_NAMES

    def _find_header(self) -> int:
        """The first line that names directions; else the first that is no comment."""
        first, commented = None, None
        for number, line in enumerate(self.lines):
            text = line.strip()
            if text.startswith("#"):
                self.comments.append(text[1:].strip())
                commented = number if names_directions(_uncommented(text)) else commented
            elif text:
                if names_directions(text):
                    first = number
                    break
                if first is None:
                    first = number
                if NUMBER_START.match(text) or number > PREAMBLE:
                    break
        if first is None:
            raise GonioError(f"{self.path} is empty: it has no header and no rows; expected CSV with a header")
        if commented is not None and NUMBER_START.match(self.lines[first].strip()):
            return commented
        self.comments += [line.strip() for line in self.lines[:first] if line.strip() and line.strip()[0] != "#"]
        return first

    def _merge_header(self) -> None:
        """Names that stand twice get what the line above says of their columns."""
        above = next((line for line in reversed(self.lines[: self.header_line]) if line.strip()), "")
        merged = merged_names(self._cells(above), self.names) if self.delimiter else None
        if merged is not None:
            self.columns, self.names = columns_of(merged), merged
            self.understood.append("the header has two lines; the upper one names groups of columns")

    def _drop_remarks(self) -> None:
        """Leaves out what is written below the last row."""
        count = max(last_row(self.lines, self.delimiter), self.first_line)
        remarks = [line.strip() for line in self.lines[count:] if line.strip()]
        if remarks and count > self.first_line:
            self.lines = self.lines[:count]
            self.understood.append(f"{one_line(remarks[0], 40)!r} below the last row is no row")

    def _take_units_row(self) -> None:
        """Units in a row of their own below the header."""
        row = next(self._data_lines(), None)
        if row is None:
            return
        cells = [re.sub(r'[\s\[\]()"]', "", cell.lower()) for cell in self._cells(row[1])]
        if len(cells) == len(self.names) and any(c in ANGLE_UNITS or c in PER_STERADIAN for c in cells):
            self.columns = columns_of(self.names, cells)
            self.first_line = row[0]
            self.understood.append("the row below the header holds units")

    def numbers(self, names: Iterable[str], missing_allowed: Iterable[str] = ()) -> dict[str, np.ndarray]:
        """The named columns as float64, NaN where `missing_allowed` and nothing is there.

        Raises GonioError, with the line, for text, gaps and values not finite.
        """
        names = list(names)
        places = {name: k for k, name in enumerate(self.names)}
        columns = [places[name] for name in names]
        if next(self._data_lines(), None) is None:
            raise GonioError(f"{self.path} has a header but no rows; expected at least one")
        self._refuse_long_rows()
        options = {"delimiter": self.delimiter or None, "usecols": columns, "comments": "#", "ndmin": 2}
        try:
            body = io.StringIO("\n".join(self.lines[self.first_line :]))
            table = np.loadtxt(body, dtype=np.float64, **options)
        except (ValueError, IndexError, OverflowError):
            table = np.array(list(self._rows_by_cell(names, columns)))
        allowed = np.isin(names, list(missing_allowed))
        bad = np.isinf(table) | (np.isnan(table) & ~allowed)
        if bad.any():
            row, column = np.argwhere(bad)[0]
            value = "missing" if np.isnan(table[row, column]) else f"{table[row, column]}"
            self.fail(row, f"{names[column][:40]} is {value}; expected a finite number")
        return dict(zip(names, table.T, strict=True))

    def _rows_by_cell(self, names: Sequence[str], columns: Sequence[int]) -> Iterator[list[float]]:
        """The numbers of these columns, row by row, in whatever way a cell is written; NaN where it is missing."""
        decimal_commas = self._decimal_commas()
        if decimal_commas:
            self.understood.append("commas are decimal")
        for number, text in self._data_lines():
            cells = self._cells(text)
            if len(cells) <= max(columns):
                name = next(n for n, k in zip(names, columns, strict=True) if k >= len(cells))
                message = f"{len(cells)} columns, but {name[:40]} is column {columns[names.index(name)] + 1}"
                raise GonioError(f"{self.path}, line {number}: {message}; complete the row")
            values = [self._value(cells[k], decimal_commas) for k in columns]
            if None in values:
                k = values.index(None)
                message = f"{names[k][:40]} is {cells[columns[k]].strip()[:40]!r}; expected a number"
                raise GonioError(f"{self.path}, line {number}: {message}")
            yield [v for v in values if v is not None]

    @staticmethod
    def _value(cell: str, decimal_comma: bool) -> float | None:
        text = cell.strip().strip('"').strip().removesuffix("°").rstrip().replace(MINUS_SIGN, "-")
        if text.lower() in MISSING:
            return math.nan
        text = text.replace(",", ".") if decimal_comma else text
        try:
            return None if "_" in text else float(FORTRAN_EXPONENT.sub("e", text))
        except ValueError:
            return None

    def _decimal_commas(self) -> bool:
        """Whether commas are decimal: they separate no columns, or stand in quotes, and no number has a point too."""
        body = "\n".join(self.lines[self.first_line :])
        if self.delimiter == ",":
            body = " ".join(re.findall(r'"\s*([-+]?\d*,\d+(?:[eE][-+]?\d+)?)\s*"', body))
        return re.search(r"\d,\d|(?<!\d),\d", body) is not None and not re.search(r"\d\.\d*,|,\d+[.,]\d", body)

    def sole(self, role: str) -> Column | None:
        """The column of a role. Raises GonioError where several may be it."""
        try:
            return sole(self.columns, role)
        except GonioError as error:
            self.refuse(str(error))

    def refuse(self, text: str) -> NoReturn:
        """Raises a GonioError that names the file."""
        raise GonioError(f"{self.path}: {text}")

    def fail(self, row: int, text: str) -> NoReturn:
        """Raises a GonioError that names the line of the data row numbered from 0."""
        raise GonioError(f"{self.path}, line {self._line_of(row)}: {text}")

    def _data_lines(self) -> Iterator[tuple[int, str]]:
        blank = f"{self.delimiter} \t\r"
        for number, line in enumerate(self.lines[self.first_line :], self.first_line + 1):
            if (text := line.split("#", 1)[0]).strip(blank):
                yield number, text.strip() if self.delimiter != "\t" else text.strip(" \r\n")

    def _line_of(self, row: int) -> int:
        return next(number for k, (number, _) in enumerate(self._data_lines()) if k == row)

    def _cells(self, line: str) -> list[str]:
        if '"' in line:
            try:
                return next(csv.reader([line], delimiter=self.delimiter or " ", skipinitialspace=True))
            except csv.Error as error:
                self.refuse(
                    f"the quotes of {one_line(line, 40)!r} hold no cells ({error}); close them or leave them out"
                )
        return line.split(self.delimiter) if self.delimiter else line.split()

    def _refuse_long_rows(self) -> None:
        # What is beyond the header's columns would be dropped: of a decimal comma all that follows it.
        width = len(self.names)
        for number, text in self._data_lines():
            if self.delimiter and text.count(self.delimiter) < width:
                continue
            extra = self._cells(text)[width:]
            if any(cell.strip() for cell in extra):
                raise GonioError(
                    f"{self.path}, line {number}: {width + len(extra)} columns under a header of "
                    f"{width}; name every column, and write decimal points, or semicolons between columns"
                )


def decoded(path: str | os.PathLike[str], limit: int | None = None, expected: str = "CSV with a header") -> str:
    """The text of a file with line feeds alone. Raises GonioError where it is absent, empty or no text."""
    input_size(path)
    with Path(path).open("rb") as file:
        data = file.read(-1 if limit is None else limit)
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = codecs.getincrementaldecoder("utf-16" if wide else "utf-8-sig")().decode(data, final=limit is None)
    except UnicodeDecodeError:
        text = "" if wide else data.decode("latin-1")
    controls = re.search(r"[\x00-\x08\x0e-\x1a\x1c-\x1f]", text)
    if (
        not text.strip("\ufeff")
        or controls
        or (wide and not text.isascii() and sum(map(str.isascii, text)) * 2 < len(text))
    ):
        raise GonioError(f"{path} is no text file; expected {expected}")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def names_directions(line: str) -> bool:
    """Whether a line is a header with the columns of a direction's pair, or most of them."""
    if not re.search(r"(?i)theta|θ|zenith|polar|w[io]|angle|aoi|sza|vza|incid|illum", line[:100_000]):
        return False
    return _widest_split(line) <= MOST_COLUMNS and _directions_in(_best_split(line)[1]) >= FEWEST_NAMES


def _widest_split(line: str) -> int:
    """The most columns that a delimiter makes of a line."""
    return max(line.count(delimiter) + 1 if delimiter else len(line.split()) for delimiter in DELIMITERS)


def _directions_in(columns: Sequence[Column]) -> int:
    return sum(c.role not in ("", "f", "u_f", "flag", "wavelength") for c in columns)


@functools.lru_cache(maxsize=8)
def _best_split(line: str) -> tuple[str, list[Column]]:
    """The delimiter that makes most sense of a header, and the header's columns."""
    best: tuple[str, list[Column]] | None = None
    for delimiter in DELIMITERS:
        # Blanks separate names but not a name from its unit.
        cells = line.split(delimiter) if delimiter else re.split(r"\s+(?![\[(])", line.strip())
        if len(cells) > 1 or best is None:
            columns = columns_of([cell.strip().strip('"').strip() for cell in cells])
            if best is None or _directions_in(columns) > _directions_in(best[1]) or len(best[1]) == 1:
                best = delimiter, columns
    assert best is not None
    return best if len(best[1]) > 1 else (",", best[1])


def _uncommented(line: str) -> str:
    return line.strip().lstrip("#").strip(" ") if line.lstrip().startswith("#") else line


def write_columns(file: TextIO, columns: dict[str, np.ndarray], comments: Iterable[str] = ()) -> None:
    """Writes columns of one length as CSV; a float is written so that reading it gives the same float."""
    for comment in comments:
        file.write(f"# {comment}\n")
    file.write(",".join(columns) + "\n")
    rows = zip(*(np.asarray(c).tolist() for c in columns.values()), strict=True)
    for row in rows:
        file.write(",".join(map(repr, row)) + "\n")
