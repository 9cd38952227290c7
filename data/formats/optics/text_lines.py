"""Lines and lists of numbers out of a stranger's text file; counts are held against the file before room is made."""

import os
import re
from typing import NoReturn

import numpy as np

from gonio.data.files import LARGEST_TEXT, input_size
from gonio.data.formats.csv.columns import decoded
from gonio.models.errors import GonioError, one_line

MOST_ANGLES = 20_000
"""Angles of one list."""
MOST_VALUES = 1 << 23
"""Values of one file."""


class TextLines:
    """A text of words and numbers apart by blanks, read line by line; blank lines and comments are passed over.

    Args:
        path: the file.
        kind: how a sentence names such a file, with its article.
        comment: how a line begins that is a comment; nothing where there are none.

    Raises:
        GonioError: absent, empty, too large or no text.
    """

    def __init__(self, path: str | os.PathLike[str], kind: str, comment: str = "#") -> None:
        self.path, self.kind, self.comment = str(path), kind, comment
        self.size = input_size(path)
        if self.size > LARGEST_TEXT:
            raise GonioError(f"{path} has {self.size >> 20} MiB; {kind} has at most {LARGEST_TEXT >> 20}")
        self.text = decoded(path, expected=kind)
        self.place = self.row = self.read = 0
        """Characters, lines and numbers read so far; the number of the last line."""
        self.comments: list[str] = []

    def fail(self, text: str) -> NoReturn:
        """Raises a GonioError that names the line read last."""
        raise GonioError(f"{self.path}, line {self.row}: {text}")

    def refuse(self, text: str) -> NoReturn:
        """Raises a GonioError that names the file."""
        raise GonioError(f"{self.path} is {self.kind}, but {text}")

    def raw(self, what: str) -> str:
        """The next line as it is. Raises GonioError at the end of the file."""
        if self.place >= len(self.text):
            self.refuse(f"it ends before {what}; copy it again")
        end = self.text.find("\n", self.place)
        start, self.place = self.place, len(self.text) + 1 if end < 0 else end + 1
        self.row += 1
        return self.text[start : self.place - 1]

    def next(self, what: str) -> str:
        """The next line that is neither blank nor a comment, without blanks at its ends. Raises as `raw` does."""
        while True:
            line = self.raw(what).strip()
            if self.comment and line.startswith(self.comment):
                self.comments.append(line.lstrip(self.comment).strip())
            elif line:
                return line

    def peek(self) -> str:
        """The line that `next` would give, or nothing at the end of the file."""
        place, row, comments = self.place, self.row, len(self.comments)
        try:
            return self.next("")
        except GonioError:
            return ""
        finally:
            self.place, self.row = place, row
            del self.comments[comments:]

    def parsed(self, line: str, what: str) -> np.ndarray:
        """The numbers of a line, NaN among them. Raises GonioError for text, and for decimal commas."""
        try:
            if "_" in line:
                raise ValueError
            return np.array(line.split(), float)
        except ValueError:
            if re.search(r"\d,\d|(?<![\d.]),\d", line):
                self.fail(f"{one_line(line, 40)!r} has decimal commas; write the file with decimal points")
            self.fail(f"{one_line(line, 40)!r} stands where {what} is expected; expected numbers")

    def numbers(self, count: int, what: str) -> np.ndarray:
        """So many numbers, on one line or several, (count,). Raises GonioError for others, and for more or fewer."""
        self.read += count
        if 2 * count > self.size + 1 or self.read > MOST_VALUES:
            self.fail(f"{what} has {count:,} numbers by the counts, which the file does not hold; copy it again")
        parts: list[np.ndarray] = []
        total = 0
        while total < count:
            parts.append(self.parsed(self.next(what), what))
            total += parts[-1].size
        if total > count:
            self.fail(f"{what} has {total} numbers, expected {count}; copy the file again")
        return parts[0] if len(parts) == 1 else np.concatenate(parts) if parts else np.zeros(0)

    def count(self, text: str, what: str, least: int = 1) -> int:
        """A whole number of a text, from `least` to `MOST_ANGLES`. Raises GonioError for others."""
        number = int(text) if re.fullmatch(r"[+-]?[0-9]{1,9}", text.strip()) else -1
        if not least <= number <= MOST_ANGLES:
            self.fail(f"{what} is {one_line(text, 30)!r}; expected a whole number from {least} to {MOST_ANGLES:,}")
        return number

    def angles(self, count: int, what: str, low: float, high: float) -> np.ndarray:
        """So many angles, degrees. Raises GonioError for those that are not finite or outside of [low, high]."""
        values = self.numbers(count, what)
        outside = ~((values >= low) & (values <= high))
        if outside.any():
            self.fail(f"{what} has the angle {values[outside][0]:g}; expected degrees from {low:g} to {high:g}")
        return values
