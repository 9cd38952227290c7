"""From integrals to quantities: values, bounds and standard uncertainties, and what is undecided."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.channels import Channels
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.standard import Integral, StandardQuantity

STEP = 1e-6
"""Relative, of slopes by the integrals."""


class Integrals(NamedTuple):
    """Values and bounds (J, C) of integrals, and why one is not known, by its number."""

    values: np.ndarray
    bounds: np.ndarray
    unknown: dict[int, str]


class Undecided(NamedTuple):
    """A quantity that the data do not reach: its name, its place, and why."""

    name: str
    place: str
    group: str
    reason: str


Spread = Callable[[StandardQuantity, np.ndarray], np.ndarray]
"""Standard uncertainty of a quantity, by its slopes by the integrals: (J, C) → (C,), or () of one number."""


def distinct(entries: Sequence[StandardQuantity]) -> list[Integral]:
    """Every integral of the quantities, once."""
    return list(dict.fromkeys(i for entry in entries for i in entry.integrals))


def slopes(entry: StandardQuantity, values: np.ndarray) -> np.ndarray:
    """Slopes (J, C) of a quantity by its own integrals (J, C): of each channel by its own, of one number by all.

    The steeper one of both sides: a difference of colours has a kink where it is 0.
    """
    middle = np.asarray(entry.combine(values))
    made = np.zeros(values.shape)
    size = np.maximum(np.abs(values), 1e-3 * np.max(np.abs(values), initial=1e-12))
    with np.errstate(invalid="ignore", divide="ignore"):
        for j in range(values.shape[0]):
            for c in range(values.shape[1]) if entry.whole else (slice(None),):
                step = np.zeros(values.shape)
                step[j, c] = STEP * size[j, c]
                high, low = (np.asarray(entry.combine(values + sign * step)) for sign in (1, -1))
                up, down = high - middle, middle - low
                made[j, c] = np.where(np.abs(up) > np.abs(down), up, down) / step[j, c]
    return made


def evaluated(
    entries: Sequence[StandardQuantity], channels: Channels, known: Integrals, spread: Spread
) -> tuple[list[Quantity], list[StandardQuantity], list[Undecided]]:
    """The quantities that are known, the entry of each, and those that are undecided."""
    integrals, rows, of, undecided = distinct(entries), [], [], []
    for entry in entries:
        index = [integrals.index(i) for i in entry.integrals]
        why = next((known.unknown[j] for j in index if j in known.unknown), None)
        if why is not None:
            undecided.append(Undecided(entry.name, entry.place, entry.group, why))
            continue
        values = known.values[index]
        value, by = np.asarray(entry.combine(values)), slopes(entry, values)
        with np.errstate(invalid="ignore"):
            bound = np.sum(np.abs(by) * known.bounds[index], axis=(0, 1) if entry.whole else 0)
        if entry.rough is not None:
            bound = bound + np.abs(value - entry.rough(values))
        u = np.hypot(spread(entry, by), 0.0 if entry.other is None else entry.other(values))
        made = _rows(entry, channels, value, bound, u)
        if all(q.decided for q in made):
            rows, of = rows + made, of + [entry] * len(made)
        else:
            undecided.append(Undecided(entry.name, entry.place, entry.group, _reason(made)))
    return rows, of, undecided


def _rows(
    entry: StandardQuantity, channels: Channels, value: np.ndarray, bound: np.ndarray, u: np.ndarray
) -> list[Quantity]:
    names = ("",) if entry.whole else channels.names
    parts = (np.broadcast_to(a, len(names)).tolist() for a in (value, bound, u))
    angles = entry.angles
    return [
        Quantity(
            entry.name, entry.place, c, v, b, dict(angles), entry.unit, entry.standard, entry.geometry, entry.group, s,
            entry.least,
        )
        for c, v, b, s in zip(names, *parts, strict=True)
    ]  # fmt: skip


def _reason(made: list[Quantity]) -> str:
    if not all(math.isfinite(q.value) for q in made):
        return "it is a ratio to nothing"
    worst = max(made, key=lambda q: q.uncertainty / max(abs(q.value), q.least, 1e-300))
    if worst.bound / math.sqrt(3) >= worst.u:
        return "the readings are too coarse for it" if worst.bound > 0 else "nothing bounds its error"
    return "its uncertainty is as large as itself"
