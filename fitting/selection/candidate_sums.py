"""Sums over the readings of several candidates at once: lobes of a kind by one call, all sums by one compiled loop."""

import functools
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.problem.arrow import Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.readings import transform
from gonio.fitting.selection.candidate_rows import (
    FRONT,
    NOTHING,
    OWN,
    TERMS,
    THROUGH,
    CandidateRows,
    Kind,
    Numbers,
    runs,
)
from gonio.fitting.selection.lobe_kernels import LOCK, lobe_values
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import Rows, SumsProgram
from gonio.models.fingerprint import program_name
from gonio.models.geometry.directions import Direction

SLOPES = (6, 12)
"""Derivatives that there are loops for; those beyond a candidate's own are of nothing."""
AT_ONCE = 1 << 14
"""Elements of a call, which one thread does."""


class Compared(NamedTuple):
    """What candidates are compared with: readings, of as many directions as processors take at a time, or more.

    `target`, `weight` of each channel (C, m); `cosine`, `front`, `through` of each direction (m,).
    """

    wi: Direction
    wo: Direction
    target: np.ndarray
    weight: np.ndarray
    cosine: np.ndarray
    front: np.ndarray
    through: np.ndarray
    loss: str
    floor: float


class _Sets(NamedTuple):
    """Sets of shapes of one kind of lobe: of which candidate each is, the shapes, and the rows."""

    kind: Kind
    lane: np.ndarray
    shapes: Numbers
    rows: np.ndarray


@functools.cache
def _program(loss: str, slopes: int) -> SumsProgram | None:
    """The sums of products of residual and derivatives, of f as a sum of terms; None where there is no such loop."""

    def rows(_: Sequence[Any], floor: Array, *elements: Array) -> Array:
        scales, (target, weight, cosine), rest = elements[:TERMS], elements[TERMS : TERMS + 3], elements[TERMS + 3 :]
        f = sum((scale * value for scale, value in zip(scales, rest[:TERMS], strict=True)), jnp.zeros(()))
        value, slope = transform(loss, f * cosine, floor)
        used, by_f = weight > 0, weight * slope * cosine
        every = [weight * (value - target), *(by_f * row for row in rest[TERMS:])]
        return jnp.where(used, jnp.stack(every), 0.0)

    try:
        name = program_name("candidate sums", loss, slopes)
        with LOCK:
            loop = Rows(rows, [], 1 + TERMS, (1,) * (3 + TERMS + slopes), name=name)
            return SumsProgram(loop, list(itertools.combinations_with_replacement(range(1 + slopes), 2)))
    except Unsupported:
        return None


class CandidateSums:
    """The sums of S candidates, some of which may be the same, over C channels of the same readings."""

    def __init__(self, data: Compared, every: list[CandidateRows], size: int, program: SumsProgram, slopes: int):
        """Of the rows of each, at vectors of so many numbers, by the loop of so many derivatives."""
        self.data, self.size, self.program, self.slopes = data, size, program, slopes
        shape = len(every), len(data.target)
        self.value, self.scale = np.full((*shape, TERMS), NOTHING), Numbers.ones(*shape, TERMS)
        self.slope, self.factor = np.full((*shape, slopes), NOTHING), Numbers.ones(*shape, slopes)
        self.place = np.full((*shape, 1 + slopes), 1 + size)
        self.place[..., 0] = 0
        self.first = OWN + np.cumsum([0, *(rows.count for rows in every)])
        added, sets = [(np.empty((0, 3), int), np.empty(0, int))], dict[Kind, list[_Sets]]()
        for rows, lanes in runs(every):
            self._fill(rows, lanes)
            added.append((self._shifted(rows.added, lanes).reshape(-1, 3), lanes.repeat(len(rows.added))))
            for lobe in rows.lobes:
                count, shapes = lobe.shapes.place.shape
                numbers = Numbers(self._flat(lobe.shapes.place, lanes), np.stack([lobe.shapes.known] * lanes.size))
                sets.setdefault(lobe.kind, []).append(
                    _Sets(
                        lobe.kind, lanes.repeat(count),
                        Numbers(*(a.reshape(lanes.size * count, shapes) for a in numbers)),
                        self._shifted(lobe.rows, lanes).reshape(-1, 1 + shapes),
                    )
                )  # fmt: skip
        self.added, self.added_lane = (np.concatenate(a) for a in zip(*added, strict=True))
        self.sets = [_joined(kind, some) for kind, some in sets.items()]
        self.rows = np.zeros((self.first[-1], data.cosine.size))
        self.rows[FRONT], self.rows[THROUGH] = data.front / np.pi, data.through / np.pi
        i, j = _upper(1 + slopes)
        self.where = self.place[..., i] * (2 + size) + self.place[..., j]
        of_channels = [np.broadcast_to(_places(a)[:, None], (*shape, 1)) for a in (data.target, data.weight)]
        of_all = np.full((*shape, 1), _places(data.cosine[None])[0])
        of_rows = [_places(self.rows)[which] for which in (self.value, self.slope)]
        self.addresses = np.concatenate([*of_channels, of_all, *of_rows], axis=2)

    def _shifted(self, rows: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Where the own rows of some candidates stand, (S, ...)."""
        start = self.first[lanes].reshape(-1, *[1] * rows.ndim) - OWN
        return np.where(rows >= OWN, rows + start, rows)

    def _flat(self, place: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Where numbers of some candidates stand among those of all, (S, ...)."""
        return np.where(place >= 0, place + self.size * lanes.reshape(-1, *[1] * place.ndim), -1)

    def _fill(self, rows: CandidateRows, lanes: np.ndarray) -> None:
        self.value[lanes], number = self._shifted(rows.value, lanes), rows.slope.shape[1]
        self.slope[lanes, :, :number] = self._shifted(rows.slope, lanes)
        self.place[lanes, :, 1 : 1 + number] = 1 + rows.place
        self.scale.set((lanes,), self._flat(rows.scale.place, lanes), rows.scale.known)
        self.factor.set(np.s_[lanes, :, :number], self._flat(rows.factor.place, lanes), rows.factor.known)

    def pairs(self, p: np.ndarray, lanes: np.ndarray) -> Float[np.ndarray, "s c pairs"] | None:
        """Sums of products of residual and derivatives, each pair once, of some candidates at p (S, size).

        None where the loop does not know that it is right.
        """
        flat, active, d = p.ravel(), np.zeros(len(self.value), bool), self.data
        active[lanes] = True
        for some in self.sets:
            keep = active[some.lane]
            if keep.any():
                shapes, which = _distinct(some.shapes.of(flat)[keep])
                values = lobe_values(*some.kind, shapes, d.wi, d.wo)[:, : d.cosine.size]
                self.rows[some.rows[keep]] = values.swapaxes(1, 2)[which]
        out, a, b = self.added[active[self.added_lane]].T
        self.rows[out] = self.rows[a] + self.rows[b]
        sums = self._summed(self.scale.of(flat)[lanes], lanes)
        if sums is None:
            return None
        factors = np.concatenate([np.ones((*sums.shape[:2], 1)), self.factor.of(flat)[lanes]], axis=2)
        i, j = _upper(1 + self.slopes)
        return sums * factors[..., i] * factors[..., j]

    def _summed(self, scale: np.ndarray, lanes: np.ndarray) -> np.ndarray | None:
        d, (number, channels) = self.data, scale.shape[:2]
        scalars = np.concatenate([np.full((number, channels, 1), d.floor), scale], axis=2)
        of_scalars = _places(scalars.reshape(-1, 1)).reshape(number, channels, -1)
        addresses = np.concatenate([of_scalars, self.addresses[lanes]], axis=2).reshape(number * channels, -1)
        count, step = d.cosine.size, max(1, AT_ONCE // d.cosine.size)
        sums = []
        for first in range(0, len(addresses), step):
            block = self.program(np.zeros(0), addresses[first : first + step], count)
            if block is None:
                return None
            sums.append(block)
        return np.concatenate(sums).reshape(number, channels, -1)

    def equations(self, p: np.ndarray, active: np.ndarray) -> NormalEquations | None:
        """The normal equations at p (S, size) of the active ones (S,), zero elsewhere; None as in `pairs`.

        Numbers beyond a candidate's own act on nothing.
        """
        lanes, wide = np.flatnonzero(active), 2 + self.size
        pairs = self.pairs(p, lanes)
        if pairs is None:
            return None
        where = self.where[lanes] + wide**2 * np.arange(lanes.size)[:, None, None]
        half = np.bincount(where.ravel(), pairs.ravel(), lanes.size * wide**2).reshape(-1, wide, wide)
        whole = np.zeros((len(p), wide, wide))
        whole[lanes] = half + half.swapaxes(1, 2) - half * np.eye(wide)
        whole = whole[:, :-1, :-1]
        return NormalEquations(0.5 * whole[:, 0, 0], whole[:, 0, 1:], Arrow.dense(whole[:, 1:, 1:]))


def _joined(kind: Kind, some: list[_Sets]) -> _Sets:
    """Sets of one kind, one after another."""
    shapes = Numbers(*(np.concatenate(a) for a in zip(*(s.shapes for s in some), strict=True)))
    return _Sets(kind, np.concatenate([s.lane for s in some]), shapes, np.concatenate([s.rows for s in some]))


def _distinct(shapes: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Sets of shapes (U, K) that differ, and which of them each one is: many starts share lobes."""
    if not shapes.shape[1]:
        return shapes[:1], [0] * len(shapes)
    known: dict[bytes, int] = {}
    which = [known.setdefault(row.tobytes(), len(known)) for row in shapes]
    return np.stack([np.frombuffer(row) for row in known]), which


@functools.cache
def _upper(size: int) -> tuple[np.ndarray, np.ndarray]:
    return np.triu_indices(size)


def _places(rows: np.ndarray) -> np.ndarray:
    """Where each row begins."""
    return (rows.ctypes.data + rows.strides[0] * np.arange(len(rows))).astype(np.uintp)


def sums_of(data: Compared, every: Sequence[CandidateRows | None], size: int) -> CandidateSums | None:
    """The sums of candidates, of at most so many numbers each; None where there is no loop for all of them."""
    known = [rows for rows in every if rows is not None]
    if not usable() or len(known) < len(every):
        return None
    slopes = next((s for s in SLOPES if s >= max(rows.slope.shape[1] for rows in known)), None)
    program = None if slopes is None else _program(data.loss, slopes)
    return None if program is None or slopes is None else CandidateSums(data, known, size, program, slopes)
