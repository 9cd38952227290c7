"""Entries of a recipe that are one value or several: texts, numbers, seeds."""

import math
import re
from typing import Any

from gonio.data.serialise import NUMBER, require_kind
from gonio.models.errors import GonioError

MOST = 200_000
"""Tasks of a campaign, and entries of a list, at most."""


def listed(value: Any, kind: type | tuple[type, ...], where: str) -> list[Any]:
    """A list of values of a kind; one alone is a list of one. Raises GonioError, naming `where`, for other kinds."""
    values = value if isinstance(value, list | tuple) else [value]
    if len(values) > MOST:
        raise GonioError(f"{where} has {len(values):,} entries; give at most {MOST:,}")
    expected = NUMBER if kind == NUMBER else str if isinstance(kind, tuple) else kind
    for one in values:
        if isinstance(one, bool) or not isinstance(one, kind):
            require_kind(one, expected, f"an entry of {where}")
    return list(values)


def numbers_of(value: Any, where: str) -> tuple[float | None, ...]:
    """Numbers above 0, without repetition; (None,) where there is no such entry."""
    if value is None:
        return (None,)
    numbers: list[float | None] = []
    for one in listed(value, NUMBER, where):
        if not (math.isfinite(one) and one > 0):
            raise GonioError(f"{where} has {one!r}; give numbers above 0")
        numbers.append(float(one))
    if not numbers:
        raise GonioError(f"{where} is empty; give one number at least, or leave it out")
    return tuple(dict.fromkeys(numbers))


def seeds_of(value: Any) -> range | tuple[int, ...]:
    """Seeds: a whole number, a list of them, or "0:100" for 0 to 99 ("0:100:5" every fifth)."""
    if isinstance(value, str):
        parts = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*(?::\s*(\d+)\s*)?", value[:100])
        if parts is None:
            raise GonioError(f'seeds is {value!r}; give a whole number, a list of them, or a range such as "0:100"')
        first, end, step = (int(p) for p in parts.groups("1"))
        if step < 1 or end > 1 << 63 or not len(range(first, min(end, first + MOST * step), step)) > 0:
            raise GonioError(f"seeds is {value!r}; give a range FROM:TO that is not empty, TO left out")
        if len(range(first, min(end, 1 << 62), step)) > MOST:
            raise GonioError(f"seeds is {value!r}; give at most {MOST:,} seeds")
        return range(first, end, step)
    seeds = listed(value, int, "seeds")
    for seed in seeds:
        if not 0 <= seed < 1 << 63:
            raise GonioError(f"seeds has {seed}; give whole numbers from 0 to 2^63 − 1")
    if not seeds:
        raise GonioError("seeds is empty; give one at least")
    return tuple(dict.fromkeys(seeds))
