"""Readings that repeat others: of the same directions, or of such as symmetry makes equal, with equal values.

A table that was mirrored, turned or made reciprocal by hand holds each of its readings several times. Its noise is in
all copies alike, so that they tell no more than one of them.
"""

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.geometry.directions import Direction

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
MIXED = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
"""Odd numbers that mix the bits of places."""


class Symmetry(NamedTuple):
    """What a model cannot tell apart: directions turned and mirrored together (`turned`), and exchanged ones."""

    turned: bool
    exchanged: bool


class Values(NamedTuple):
    """Values of readings and their validity, both (n, C)."""

    f: np.ndarray
    valid: np.ndarray


def first_copies(wi: Direction, wo: Direction, values: Values, symmetry: Symmetry) -> np.ndarray | None:
    """The reading (n,) that each of the readings repeats, itself where it repeats none; None where they are no copies.

    They are copies where most of the values that lie beside another of the same place are equal to it: noise would
    make them differ. A value of 0 tells nothing, for negative readings are often cut there. Of more readings than
    `MOST` none are looked for.
    """
    number = values.f.shape[0]
    if number > MOST or not _values_repeat(values.f[:, 0]):
        return None
    order, copied, share = _ordered(places(wi, wo, symmetry), values)
    if share < MOSTLY:
        return None
    begins = np.flatnonzero(np.concatenate([[True], ~copied]))
    first = np.empty(number, np.intp)
    first[order] = np.repeat(order[begins], np.diff(begins, append=number))
    return first


def repeated(table: Table) -> np.ndarray | None:
    """How often (n,) each reading with a stated uncertainty stands, mirrored or turned; None where none is repeated.

    What is one error in m readings counts in a sum over all of them as m independent ones of √m times its size. Sums
    that look at one of them alone then hold too much.
    """
    if table.u_f is None or table.interpolant is not None or table.layout.size > MOST:
        return None
    cells = np.arange(table.layout.size)
    blocks = (cells[k : k + LOOKED_AT] for k in range(0, cells.size, LOOKED_AT))  # of a large table all is much memory
    values = np.concatenate([np.asarray(table.values_at(b)["f"]).reshape(b.size, -1)[:, 0] for b in blocks])
    if not _values_repeat(values):
        return None
    block = table.values_at(cells)
    f, u, flag = (np.asarray(block[name]).reshape(table.layout.size, -1) for name in ("f", "u_f", "flag"))
    valid = (flag == Flag.VALID) & np.isfinite(f)
    if not (valid & (u > 0)).any():
        return None
    first = first_copies(*table.layout.directions(), Values(np.where(valid, f, 0.0), valid), Symmetry(True, False))
    return None if first is None else np.bincount(first, minlength=first.size)[first]


def with_noise_of_copies(table: Table, times: np.ndarray | None) -> Table:
    """The table with √m times its uncertainties where a reading stands m `times` (n,), see `repeated`."""
    return table if times is None else dataclasses.replace(table, u_f=noise_of_copies(table.u_f, times))


def noise_of_copies(u_f: Any, times: np.ndarray) -> np.ndarray:
    """Uncertainties of a table's cells times the root of how often each stands (n,); the shape of u_f."""
    u = np.asarray(u_f[...], float)
    return (u.reshape(times.size, -1) * np.sqrt(times)[:, None]).reshape(u.shape)


def may_hold_copies(places_and_values: Iterable[tuple[np.ndarray, Values]], number: int) -> bool:
    """Whether `first_copies` may find any, told by the readings of some places: all those of a place are looked at.

    Args:
        places_and_values: of so many readings in turn, of each as `places` gives them.
        number: of readings.
    """
    if number > MOST:
        return False
    keys, f, valid, few = list[np.ndarray](), list[np.ndarray](), list[np.ndarray](), max(1, number // LOOKED_AT)
    for key, values in places_and_values:
        some = np.flatnonzero((key >> np.uint64(20)) % np.uint64(few) == 0)
        for chosen, a in zip((keys, f, valid), (key, *values), strict=True):
            chosen.append(a[some])
    share = _ordered(np.concatenate(keys), Values(np.concatenate(f), np.concatenate(valid)))[2]
    return share >= (MOSTLY if few == 1 else MOSTLY / 2)


def _ordered(key: np.ndarray, values: Values) -> tuple[np.ndarray, np.ndarray, float]:
    """The order (n,) of readings by place and value, which repeat the one before, and the share that are copies.

    The share is that of readings beside others of the same place which tell anything; 0 where there are none.
    """
    order = np.lexsort((values.f[:, 0], key))
    same_place = key[order[1:]] == key[order[:-1]]
    copied = same_place & _equal(values, order[1:], order[:-1])
    judged = _either(same_place) & np.any(values.valid & (values.f != 0), axis=1)[order]
    return order, copied, float(np.mean(_either(copied)[judged])) if judged.any() else 0.0


def _either(pairs: np.ndarray) -> np.ndarray:
    """Which of n ordered readings are in one of the pairs (n − 1,) of each with the next."""
    return np.concatenate([pairs, [False]]) | np.concatenate([[False], pairs])


def _values_repeat(values: np.ndarray) -> bool:
    """Whether many values stand more than once. Of a large table those are compared whose bits say so by chance."""
    bits = np.ascontiguousarray(values, np.float64).view(np.uint64)
    few = max(1, bits.size // LOOKED_AT)
    if few > 1:
        bits = bits[(bits * MIXED[0] >> np.uint64(40)) % np.uint64(few) == 0]
    if bits.size < 2:
        return False
    ordered = np.sort(bits)
    repeated = float(np.mean(ordered[1:] == ordered[:-1]))
    return repeated > (RARE if few > 1 else 0.0)


def places(wi: Direction, wo: Direction, symmetry: Symmetry) -> np.ndarray:
    """A number (n,) for each pair of directions, equal for those that cannot be told apart."""
    i, o = (np.stack([np.asarray(c, float) for c in w]) for w in (wi, wo))
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


def _equal(values: Values, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which of the readings a and b (m,) are equal in all channels, or missing in both."""
    (fa, va), (fb, vb) = ((values.f[k], values.valid[k]) for k in (a, b))
    close = np.abs(fa - fb) <= EQUAL * np.maximum(np.abs(fa), np.abs(fb))
    return np.all((close & va & vb) | (~va & ~vb), axis=1)
