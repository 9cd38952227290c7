"""What an SSDD file holds [libbsdf, version 0.3]: blocks of lists of angles and of values, text or binary."""

import os
import re
from typing import NamedTuple, NoReturn

import numpy as np

from gonio.data.channels import Channels
from gonio.data.files import input_size
from gonio.data.formats.laboratory.number_rows import number_rows
from gonio.models.errors import GonioError, nearest, printable

MOST_BYTES = 1 << 28
MOST_ANGLES = 20_000
"""Of one list."""
MOST_LINE = 1 << 20
KINDS = ("brdf", "btdf", "specular_reflectance", "specular_transmittance")
COLOURS = {"monochrome": 1, "rgb": 3, "xyz": 3, "spectrum": 0}
"""Values of a colour; 0: one for each wavelength."""
PARAMETERS = (
    "spherical_coordinate_system",
    "specular_coordinate_system",
    "half_difference_coordinate_system",
    "distorted_spherical_coordinate_system",
)
REDUCTIONS = ("bilateral_symmetry", "reciprocity")
LISTS = tuple(f"PARAM{k}_LIST" for k in range(5))
MARK = "gonio flags:"
"""How a comment begins that holds the flags of a block's values."""


class Block(NamedTuple):
    """One of the blocks of a file."""

    kind: str
    colour: str
    parameters: str
    reductions: tuple[str, ...]
    lists: tuple[np.ndarray, ...]
    """Degrees, of each of the five parameters."""
    wavelengths: np.ndarray
    values: np.ndarray
    """(parameter 0, 1, 2, 3, channel)."""
    flags: np.ndarray | None
    """uint8, of the same shape, where gonio wrote the file."""
    stated: dict[str, str]

    @property
    def channels(self) -> Channels:
        """The channels of the values."""
        if self.colour == "spectrum":
            return Channels.of_wavelengths(self.wavelengths)
        return Channels(("X", "Y", "Z")) if self.colour == "xyz" else Channels.of_count(self.values.shape[-1])


def read_blocks(path: str | os.PathLike[str]) -> tuple[list[Block], dict[str, str]]:
    """The blocks of a file and what its header states. Raises GonioError, in one sentence, for a damaged file."""
    reader = _Reader(path)
    header, blocks = reader.entries("DATA_TYPE"), []
    while reader.place < len(reader.data):
        blocks.append(_block(reader))
        reader.comments.clear()
        if not reader.skip():
            break
    kinds = [block.kind for block in blocks]
    if not {"brdf", "btdf"} & set(kinds) or len(set(kinds)) < len(kinds):
        raise GonioError(f"{path} has the blocks {', '.join(kinds)[:80] or 'none'}; expected one brdf or btdf, or both")
    return blocks, header


class _Reader:
    """Lines of text, and bytes between them."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = path
        if (size := input_size(path)) > MOST_BYTES:
            raise GonioError(f"{path} has {size >> 20} MiB; an SSDD file has at most {MOST_BYTES >> 20}")
        with open(path, "rb") as file:
            self.data = file.read()
        self.place = 0
        self.comments: list[str] = []

    def refuse(self, text: str) -> NoReturn:
        """Raises a GonioError that names the file."""
        raise GonioError(f"{self.path} is a damaged SSDD file: {text}; export it again")

    def line(self) -> str:
        """The next line."""
        end = self.data.find(b"\n", self.place, self.place + MOST_LINE)
        if end < 0 and len(self.data) - self.place > MOST_LINE:
            self.refuse("a line of its text does not end")
        end = len(self.data) if end < 0 else end
        text, self.place = self.data[self.place : end].decode("utf-8", "replace"), end + 1
        return text.strip().lstrip("\ufeff")

    def skip(self) -> bool:
        """Passes over blank lines and comments; False at the end of the file."""
        while self.place < len(self.data):
            start, text = self.place, self.line()
            if text.startswith("#"):
                self.comments.append(text[1:].strip())
            elif text:
                self.place = start
                return True
        return False

    def entries(self, last: str) -> dict[str, str]:
        """The entries up to the one that is `last`, which is left where it is unless it is DATA."""
        result: dict[str, str] = {}
        while True:
            if not self.skip():
                self.refuse(f"it ends before {last}")
            start = self.place
            key, _, value = self.line().partition(" ")
            if key == last and last == "DATA_TYPE":
                self.place = start
                return result
            if key in result or len(result) > 100:
                self.refuse(f"it has the entry {printable(key[:40])} twice, or too many")
            result[key] = printable(value.strip())
            if key == last:
                return result

    def values(self, mode: str, rows: int, columns: int) -> np.ndarray:
        """So many rows of so many values."""
        remaining = len(self.data) - self.place
        if mode == "binary":
            if 4 * rows * columns > remaining:
                self.refuse(f"it has {remaining:,} bytes for {rows * columns:,} values of four")
            result = np.frombuffer(self.data, "<f4", rows * columns, self.place)
            self.place += 4 * rows * columns
            return result.reshape(rows, columns)
        if mode != "ascii":
            self.refuse(f"its data are {mode[:20]!r}, neither ascii nor binary")
        if 2 * rows * columns > remaining + 1:
            self.refuse(f"it has {remaining:,} bytes for {rows * columns:,} values")
        lines: list[str] = []
        while len(lines) < rows and self.skip():
            lines.append(self.line())
        if len(lines) < rows:
            self.refuse(f"it ends after {len(lines):,} of {rows:,} rows of values")
        return number_rows(self.path, lines, columns)


def _block(reader: _Reader) -> Block:
    """The next block, meta-data and values."""
    entries = reader.entries("DATA")
    kind, colour = entries.pop("DATA_TYPE", ""), entries.pop("COLOR_MODEL", "")
    delta = kind.startswith("specular")
    parameters = entries.pop("PARAM_TYPE", PARAMETERS[0] if delta else "")
    reductions = tuple(entries.pop("REDUCTION_TYPE", "").split())
    for name, word, known in (
        ("DATA_TYPE", kind, KINDS), ("COLOR_MODEL", colour, COLOURS), ("PARAM_TYPE", parameters, PARAMETERS),
        *(("REDUCTION_TYPE", r, REDUCTIONS) for r in reductions),
    ):  # fmt: skip
        if word not in known:
            reader.refuse(f"{name} is {word[:60]!r}, {nearest(word[:60], known)}")
    wavelengths = _numbers(reader, "WAVELENGTH_LIST", entries.pop("WAVELENGTH_LIST", ""))
    lists = [_numbers(reader, name, entries.pop(name, "")) for name in LISTS]
    lists[1] = lists[1] if lists[1].size else np.zeros(1)
    if delta:
        lists[2:4] = [np.zeros(1), np.zeros(1)]
    if not all(a.size for a in lists[:4]) or lists[4].size not in (0, lists[0].size):
        reader.refuse("one of its lists of parameters is empty, or of another length than the first")
    for name, angles in zip(LISTS[:4], lists, strict=False):
        if (np.diff(angles) <= 0).any():
            reader.refuse(f"{name} is not in ascending order")
    columns = COLOURS[colour] or wavelengths.size
    if not columns:
        reader.refuse("it is a spectrum without WAVELENGTH_LIST")
    shape = tuple(a.size for a in lists[:4])
    rows = int(np.prod([float(n) for n in shape]))
    values = reader.values(entries.pop("DATA"), rows, columns)
    values = values.reshape(*shape[::-1], columns).transpose(3, 2, 1, 0, 4)
    flags = _flags(reader.comments, values.shape)
    return Block(kind, colour, parameters, reductions, tuple(lists), wavelengths, values, flags, entries)


def _numbers(reader: _Reader, name: str, text: str) -> np.ndarray:
    try:
        numbers = np.array(text.split(), np.float64)
    except ValueError:
        reader.refuse(f"{name} has {text[:40]!r}, which is not all numbers")
    if numbers.size > MOST_ANGLES or not np.isfinite(numbers).all():
        reader.refuse(f"{name} has {numbers.size:,} numbers, or some that are not finite")
    return numbers


def _flags(comments: list[str], shape: tuple[int, ...]) -> np.ndarray | None:
    """The flags that a comment of gonio's holds, as pairs ``flag*count`` in the order of the values."""
    text = next((c[len(MARK) :] for c in comments if c.startswith(MARK)), None)
    if text is None:
        return None
    runs = np.array([(int(a), int(b)) for a, b in re.findall(r"\b(\d)\*(\d{1,9})\b", text)], np.int64).reshape(-1, 2)
    if runs[:, 1].sum() != np.prod(shape):
        return None
    flags = np.repeat(runs[:, 0], runs[:, 1]).astype(np.uint8)
    return np.minimum(flags, 5).reshape(*shape[3::-1], shape[4]).transpose(3, 2, 1, 0, 4)
