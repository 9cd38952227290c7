"""Columns of numbers out of a CSV text, with the line of whatever is wrong; and numbers into one, at full precision."""

import io
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np

from gonio.data.files import input_size
from gonio.models.errors import GonioError


class CsvText:
    """A CSV file: '#' comment lines, a header of column names, then rows of numbers; blank lines are ignored.

    `limit`: only so many characters are read, enough for the header. Columns are separated by commas (or by
    semicolons or tabs, if the header has no comma). Raises GonioError where the file is absent, empty, no
    text or without a header.
    """

    def __init__(self, path: str | os.PathLike[str], limit: int | None = None) -> None:
        self.path = str(path)
        input_size(path)
        try:
            with Path(path).open(encoding="utf-8-sig") as file:
                self.text = file.read(limit)
        except (UnicodeDecodeError, OSError):
            raise GonioError(f"{path} is no text file; expected CSV with a header") from None
        self.comments: list[str] = []
        self.lines = self.text.split("\n")
        self.header_line = self._find_header()
        header = self.lines[self.header_line]
        self.delimiter = next((d for d in ",;\t" if d in header), ",")
        self.names = [name.strip().strip('"') for name in header.split(self.delimiter)]
        doubles = sorted({n for n in self.names if self.names.count(n) > 1})
        if doubles:
            raise GonioError(f"{self.path} has the column {doubles[0]!r} twice; rename or remove one")

    def _find_header(self) -> int:
        for number, line in enumerate(self.lines):
            if line.lstrip().startswith("#"):
                self.comments.append(line.lstrip()[1:].strip())
            elif line.strip():
                return number
        raise GonioError(f"{self.path} is empty: it has no header and no rows; expected CSV with a header")

    def numbers(self, names: Iterable[str], nan_allowed: Iterable[str] = ()) -> dict[str, np.ndarray]:
        """The named columns as float64. Raises GonioError, with the line, for text, gaps and values not finite."""
        names = list(names)
        columns = [self.names.index(name) for name in names]
        if next(self._data_lines(), None) is None:
            raise GonioError(f"{self.path} has a header but no rows; expected at least one")
        self._refuse_long_rows()
        options = {"delimiter": self.delimiter, "usecols": columns, "skiprows": self.header_line + 1}
        try:
            table = np.loadtxt(io.StringIO(self.text), comments="#", ndmin=2, dtype=np.float64, **options)
        except (ValueError, IndexError, OverflowError):
            self._explain(names, columns)
            raise GonioError(f"{self.path} has rows that are no numbers; expected {', '.join(names)}") from None
        bad = ~np.isfinite(table)
        bad[:, [k for k, name in enumerate(names) if name in nan_allowed]] = False
        if bad.any():
            row, column = np.argwhere(bad)[0]
            self.fail(row, f"{names[column]} is {table[row, column]}; expected a finite number")
        return dict(zip(names, table.T, strict=True))

    def fail(self, row: int, text: str) -> NoReturn:
        """Raises a GonioError that names the line of the data row numbered from 0."""
        raise GonioError(f"{self.path}, line {self._line_of(row)}: {text}")

    def _data_lines(self) -> Iterator[tuple[int, str]]:
        for number, line in enumerate(self.lines[self.header_line + 1 :], self.header_line + 2):
            if text := line.split("#", 1)[0].strip():
                yield number, text

    def _line_of(self, row: int) -> int:
        return next(number for k, (number, _) in enumerate(self._data_lines()) if k == row)

    def _refuse_long_rows(self) -> None:
        # What is beyond the header's columns would be dropped: of a decimal comma all that follows it.
        for number, text in self._data_lines():
            if text.count(self.delimiter) >= len(self.names):
                extra = text.split(self.delimiter)[len(self.names) :]
                if any(cell.strip() for cell in extra):
                    raise GonioError(
                        f"{self.path}, line {number}: {len(self.names) + len(extra)} columns under a header of "
                        f"{len(self.names)}; name every column, and write decimal points, or semicolons between columns"
                    )

    def _explain(self, names: Sequence[str], columns: Sequence[int]) -> None:
        for number, text in self._data_lines():
            cells = text.split(self.delimiter)
            for name, k in zip(names, columns, strict=True):
                if k >= len(cells):
                    message = f"{len(cells)} columns, but {name} is column {k + 1}; complete the row"
                    raise GonioError(f"{self.path}, line {number}: {message}")
                try:
                    float(cells[k])
                except ValueError:
                    message = f"{name} is {cells[k].strip()[:40]!r}; expected a number"
                    raise GonioError(f"{self.path}, line {number}: {message}") from None


def write_columns(file: TextIO, columns: dict[str, np.ndarray], comments: Iterable[str] = ()) -> None:
    """Writes columns of one length as CSV; a float is written so that reading it gives the same float."""
    for comment in comments:
        file.write(f"# {comment}\n")
    file.write(",".join(columns) + "\n")
    rows = zip(*(np.asarray(c).tolist() for c in columns.values()), strict=True)
    for row in rows:
        file.write(",".join(map(repr, row)) + "\n")
