"""Lines of numbers out of text files of bounded size, with the line of whatever is wrong."""

import os
from collections.abc import Sequence

import numpy as np

from gonio.data.files import input_size
from gonio.data.formats.csv.columns import decoded
from gonio.models.errors import GonioError

MOST_BYTES = 1 << 27
LONGEST_LINE = 1 << 20


def text_lines(path: str | os.PathLike[str], kind: str) -> list[str]:
    """The lines of a text file. Raises GonioError where it is no text, or larger than such a file is.

    Args:
        path: the file.
        kind: what it is, for messages.
    """
    if (size := input_size(path)) > MOST_BYTES:
        raise GonioError(f"{path} has {size >> 20} MiB; {kind} has at most {MOST_BYTES >> 20}")
    return decoded(path).split("\n")


def number_rows(
    path: str | os.PathLike[str], lines: Sequence[str], columns: int, delimiter: str = "", first: int = 1
) -> np.ndarray:
    """The numbers of lines, (rows, columns); blank lines and those that begin with '#' are passed over.

    Args:
        path: the file, for messages.
        lines: the lines.
        columns: how many numbers each has.
        delimiter: between numbers; "" stands for blanks.
        first: number of the first line in its file.

    Raises:
        GonioError: with the line, for another count of columns and for what is no number.
    """
    rows = [line for line in lines if (bare := line.lstrip()) and not bare.startswith("#")]
    if not rows:
        return np.empty((0, columns))
    try:
        if max(map(len, rows)) <= LONGEST_LINE:
            numbers = np.loadtxt(rows, np.float64, delimiter=delimiter or None, comments=None, ndmin=2)
            if numbers.shape == (len(rows), columns):
                return numbers
    except (ValueError, OverflowError):
        pass
    for number, line in enumerate(lines, first):
        if (bare := line.strip()) and not bare.startswith("#"):
            _refuse(f"{path}, line {number}", bare, columns, delimiter)
    raise GonioError(f"{path} has rows that cannot be read as {columns} numbers each; export it again")


def _refuse(where: str, line: str, columns: int, delimiter: str) -> None:
    """Raises GonioError where a line does not have these many numbers."""
    cells = line[:LONGEST_LINE].split(delimiter or None)
    if len(cells) != columns:
        raise GonioError(f"{where}: {len(cells)} columns, expected {columns}; complete the row")
    for cell in cells:
        try:
            float(cell)
        except ValueError:
            raise GonioError(f"{where}: {cell.strip()[:40]!r} is no number") from None
