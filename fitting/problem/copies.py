"""Readings that repeat others: of the same directions, or of such as symmetry makes equal, with equal values.

A table that was mirrored, turned or made reciprocal by hand holds each of its readings several times. Its noise is in
all copies alike, so that they tell no more than one of them.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.problem.parameterisation import parameters
from gonio.fitting.problem.readings import Readings
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Term

EQUAL = 4 * float(np.finfo(np.float32).eps)
"""Relative difference of values up to which they are one, stored in single precision."""
SAME_PLACE = 1e-6
"""Difference of a direction's components, or of a cosine, up to which places are one."""
ASIDE = 0.37
"""Where rounding cuts, in such steps: away from the round numbers that nodes lie on."""
MOSTLY = 0.5
"""Share of equal values among places read more than once, from which on they are copies."""
LOOKED_AT = 1 << 16
"""Readings of which all are compared; of more, first some of those values that repeat."""
RARE = 0.1
"""Share of values that repeat, up to which chance may explain it and no number moves by it."""
MOST = 1 << 22
"""Readings of which copies are looked for: sorting more would take more memory than a fit of them."""
STEP = 1e-3
"""Relative change by which free numbers differ, so that widths which may differ do."""
MIXED = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
"""Odd numbers that mix the bits of places."""


class Symmetry(NamedTuple):
    """What a model cannot tell apart: directions turned and mirrored together (`turned`), and exchanged ones."""

    turned: bool
    exchanged: bool


class DistinctReadings(NamedTuple):
    """The readings without copies, how often (k,) each of them is in the table, and how many copies were left out."""

    readings: Readings
    times: np.ndarray
    left_out: int


def symmetry_of(models: Sequence[tuple[Term, ...]], channels: Channels) -> Symmetry:
    """What none of the models can tell apart, whatever their free numbers."""
    turned, exchanged = True, True
    for terms in models:
        s, _, given = parameters(terms, len(channels))
        moved = np.asarray(given) * (1.0 + STEP * np.arange(1, s.size + 1))
        brdf = build(s.filled(terms, [moved]), np.asarray)
        turned &= brdf.isotropic and brdf.symmetric
        exchanged &= "reciprocity" not in brdf.violates
    return Symmetry(turned, exchanged)


def distinct_readings(readings: Readings, symmetry: Symmetry) -> DistinctReadings | None:
    """The readings without those that repeat others; None where they are no copies.

    They are copies where most of the values that lie beside another of the same place are equal to it: noise would
    make them differ. A value of 0 tells nothing, for negative readings are often cut there. Of more readings than
    `MOST` none are looked for.
    """
    if readings.f.shape[0] > MOST or not _values_repeat(readings):
        return None
    key = _places(readings, symmetry)
    order = np.lexsort((readings.f[:, 0], key))
    same_place = key[order[1:]] == key[order[:-1]]
    equal, telling = _compared(readings, order[1:], order[:-1])
    has_copy, has_other = _either(equal & same_place), _either(same_place)
    judged = has_other & telling[order]
    if not judged.any() or np.mean(has_copy[judged]) < MOSTLY:
        return None
    begins = np.concatenate([[True], ~(equal & same_place)])
    kept, times = order[begins], np.diff(np.flatnonzero(begins), append=order.size)
    in_table = np.argsort(kept)
    return DistinctReadings(readings.part(kept[in_table]), times[in_table], order.size - kept.size)


def _either(pairs: np.ndarray) -> np.ndarray:
    """Which of n ordered readings are in one of the pairs (n − 1,) of each with the next."""
    return np.concatenate([pairs, [False]]) | np.concatenate([[False], pairs])


def weighted_as_read(distinct: DistinctReadings, noise_known: bool) -> Readings:
    """The distinct readings with weights for a fit: once each where the noise is known, else as often as they stand.

    Without known noise the numbers are those that all readings give, and their uncertainties those of the distinct.
    """
    return distinct.readings if noise_known else dataclasses.replace(distinct.readings, cell_weight=distinct.times)


def _values_repeat(readings: Readings) -> bool:
    """Whether many values stand more than once. Of a large table those are compared whose bits say so by chance."""
    values = np.asarray(readings.f[:, 0], np.float32)
    bits = values.view(np.uint32)
    few = max(1, values.size // LOOKED_AT)
    if few > 1:
        bits = bits[(bits * np.uint32(MIXED[0] & np.uint64(0xFFFFFFFF)) >> np.uint32(16)) % np.uint32(few) == 0]
    if bits.size < 2:
        return False
    ordered = np.sort(bits)
    repeated = float(np.mean(ordered[1:] == ordered[:-1]))
    return repeated > (RARE if few > 1 else 0.0)


def _places(readings: Readings, symmetry: Symmetry) -> np.ndarray:
    """A number (n,) for each pair of directions, equal for those that cannot be told apart."""
    i, o = (np.stack([np.asarray(c, float) for c in w]) for w in (readings.wi, readings.wo))
    between: Any = np.uint64(0)
    if symmetry.turned:
        between = _mixed(np.sum(i * o, axis=0)[None])
        i, o = i[2:], o[2:]
    other = np.uint64(1) if symmetry.exchanged else MIXED[2]
    return _mixed(i) + other * _mixed(o) + MIXED[1] * between


def _mixed(components: np.ndarray) -> np.ndarray:
    """A number (n,) for components (k, n), equal where they are within `SAME_PLACE`."""
    steps = np.floor(components / SAME_PLACE + ASIDE).astype(np.int64).view(np.uint64)
    number = np.zeros(components.shape[1], np.uint64)
    for row in steps:
        number = (number + row) * MIXED[0]
        number ^= number >> np.uint64(29)
    return number * MIXED[1]


def _compared(readings: Readings, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the readings a and b (m,) are equal in all channels; which of all (n,) are not 0."""
    f, valid = readings.f, readings.valid
    close = np.abs(f[a] - f[b]) <= EQUAL * np.maximum(np.abs(f[a]), np.abs(f[b]))
    alike = (close & valid[a] & valid[b]) | (~valid[a] & ~valid[b])
    return np.all(alike, axis=1), np.any(valid & (f != 0), axis=1)
