"""Headers of laboratories that are no single line of names: two lines, or pairs of angles over rows of wavelengths."""

import re
from collections.abc import Sequence

from gonio.data.formats.csv.header import LENGTHS_NM, column_of

ANGLE = r"\s*([-+]?\d+(?:[.,]\d+)?)\s*°?\s*"
PAIR = re.compile(rf'"?{ANGLE}[/:]{ANGLE}"?')
UNIT_AT_END = re.compile(r"(.*?\S)\s*(?:/\s*([^\s/\[(]+)|[\[(]\s*([^\[\]()]+?)\s*[\])])")
FACTOR = re.compile(r"(?i)\b(?:radiance|luminance|reflectance)[ _-]factor|\bBRF\b")
"""Words above the header by which values are reflectance factors."""
MOST_PAIRS, PREAMBLE, MOST_LENGTH = 2000, 200, 100_000
"""Columns of geometries; lines among which their header is looked for; characters of such a line."""


def merged_names(above: Sequence[str], names: Sequence[str]) -> list[str] | None:
    """Names of a header whose upper line stands once over several columns, such as "450 nm" over value and uncertainty.

    None where the upper line has not as many cells, or the names stay the same twice.
    """
    if len(above) != len(names):
        return None
    label, merged = "", []
    for over, name in zip(above, names, strict=True):
        label = over.strip() or label
        if names.count(name) == 1:
            merged.append(name)
            continue
        unit = UNIT_AT_END.fullmatch(name.strip())
        stem, of = (unit[1], f" [{unit[2] or unit[3]}]") if unit else (name.strip(), "")
        merged.append(f"{stem} {label}{of}")
    return merged if len(set(merged)) == len(merged) else None


def without_turned_rows(lines: list[str]) -> list[str]:
    """The lines, where columns are geometries (``45/0``: light, detector) and rows wavelengths turned over.

    A row a geometry follows from them, of theta_i, theta_o, and f of each wavelength; other texts stay as they are.
    """
    for number, line in enumerate(lines[:PREAMBLE]):
        if line.startswith("#") or len(line) > MOST_LENGTH:
            continue
        for delimiter in (";", "\t", ","):
            first, *others = line.split(delimiter)
            pairs = [PAIR.fullmatch(cell.strip()) for cell in others]
            if len(pairs) > 1 and len(pairs) <= MOST_PAIRS and all(pairs) and _is_wavelength(first):
                quantity = "beta" if any(FACTOR.search(before) for before in lines[:number]) else "f"
                unit = column_of(first).unit or "nm"
                turned = _turned(lines[number + 1 :], delimiter, (quantity, unit), len(pairs))
                if turned is None:
                    return lines
                names, values = turned
                rows = [delimiter.join([m[1], m[2], *(row[k] for row in values)]) for k, m in enumerate(pairs) if m]
                return [*lines[:number], delimiter.join(["theta_i", "theta_o", *names]), *rows]
    return lines


def _is_wavelength(name: str) -> bool:
    return column_of(name).role == "wavelength"


def last_row(lines: Sequence[str], delimiter: str) -> int:
    """How many lines are left without remarks at the end, words without a number or a delimiter."""
    count = len(lines)
    while count and not re.search(rf"[\d#{re.escape(delimiter)}]", lines[count - 1]):
        count -= 1
    return count


def _turned(
    lines: Sequence[str], delimiter: str, quantity: tuple[str, str], count: int
) -> tuple[list[str], list[list[str]]] | None:
    """(names of a column for each wavelength, its cells); None of rows that are no wavelength and `count` cells."""
    names, values = [], []
    name, unit = quantity
    for line in lines:
        if not line.split("#", 1)[0].strip(f"{delimiter} "):
            continue
        first, *cells = (cell.strip() for cell in line.split("#", 1)[0].split(delimiter))
        if len(cells) != count or unit not in LENGTHS_NM or not re.fullmatch(r"\d+(?:[.,]\d+)?", first):
            return None
        names.append(f"{name}_{first.replace(',', '.')}{unit}")
        values.append(cells)
    return (names, values) if names else None
