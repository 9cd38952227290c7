"""What a format of files is: how it is recognised, read and written."""

import dataclasses
import functools
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from gonio.data.files import input_size
from gonio.data.formats.csv_columns import CsvText
from gonio.data.round_trip import RoundTrip
from gonio.data.table import Table

if TYPE_CHECKING:
    from gonio.data.material import Material

HEAD_BYTES = 4096
HEADER_CHARACTERS = 1 << 16


@dataclasses.dataclass(frozen=True)
class FileHead:
    """The beginning of a file, by which its format is recognised."""

    path: str
    size: int
    """Bytes of the whole file."""
    start: bytes

    @property
    def suffix(self) -> str:
        """The ending of the name, small letters."""
        return os.path.splitext(self.path)[1].lower()

    @property
    def binary(self) -> bool:
        """Whether the file is no text."""
        return b"\0" in self.start

    @functools.cached_property
    def columns(self) -> list[str]:
        """The header of a text file as names of columns. Raises GonioError for a text that has none."""
        return [] if self.binary else CsvText(self.path, HEADER_CHARACTERS).names


def file_head(path: str | os.PathLike[str]) -> FileHead:
    """The head of a file. Raises GonioError where it is absent, a folder, empty or not readable."""
    size = input_size(path)
    with open(path, "rb") as file:
        return FileHead(os.fspath(path), size, file.read(HEAD_BYTES))


def stem(path: str | os.PathLike[str]) -> str:
    """The name of a file without folder and ending: what a table is called that has no name in its file."""
    return os.path.splitext(os.path.basename(path))[0]


@dataclasses.dataclass(frozen=True)
class Format:
    """A format: to add one, a file with a `FORMAT` of this type, and its line in `gonio.data.formats.registry`."""

    name: str
    title: str
    """How a sentence names such a file."""
    holds: Literal["table", "model"]
    sniff: Callable[[FileHead], bool]
    read: Callable[..., "Table | Material"]
    write: Callable[..., RoundTrip] | None = None
    options: tuple[str, ...] = ()
    """Keywords of `read`."""
    suffixes: tuple[str, ...] = ()
    """Endings by which the format of an output is chosen, the usual one first."""
    entries: Callable[[str | os.PathLike[str]], list[str]] | None = None
    """The names in a file of several materials; `read` then takes one as `entry`, written FILE:NAME."""
