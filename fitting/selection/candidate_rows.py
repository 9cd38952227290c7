"""Of which rows of lobe values a candidate's sums are made, with which of its numbers in front."""

import dataclasses
import functools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gonio.fitting.selection.candidate_columns import DIFFUSE, TermColumns, candidate_parameters, lobe_of, term_columns
from gonio.fitting.selection.term_spec import Terms, TermSpec
from gonio.models.expression.builder import Frame

TERMS = 4
"""Terms of a candidate, at most."""
NOTHING, FRONT, THROUGH, OWN = range(4)
"""Rows that all candidates share: zeros, 1/π in front, 1/π on different sides; and the first of their own."""

Kind = tuple[Frame, tuple[str, ...]]
"""A lobe without its shapes, and their names."""


class Numbers(NamedTuple):
    """`known`, times a number where `place`, its place among those of the normal equations, is not −1."""

    place: np.ndarray
    known: np.ndarray

    @classmethod
    def ones(cls, *shape: int) -> "Numbers":
        """No number anywhere."""
        return cls(np.full(shape, -1), np.ones(shape))

    def set(self, where: tuple, place: np.ndarray | int, known: np.ndarray | float) -> None:
        """Fill in some of them."""
        self.place[where], self.known[where] = place, known

    def of(self, p: np.ndarray) -> np.ndarray:
        """What they are among the numbers p (P,)."""
        return np.where(self.place >= 0, p[self.place], 1.0) * self.known


class LobeSets(NamedTuple):
    """A lobe at M sets of shapes, one or one of each channel: its shapes (M, K), and its rows (M, 1 + K)."""

    kind: Kind
    shapes: Numbers
    rows: np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class CandidateRows:
    """The rows of a candidate over C channels with G free parameters.

    f is Σ scale · row over the terms, its derivative by a free parameter factor · row.

    Attributes:
        lobes: what the rows hold.
        added: rows (A, 3) that are each the sum of two others.
        count: of its own rows.
        value, scale: of f, of each channel and term (C, TERMS).
        slope, factor: of the derivatives, of each channel and free parameter (C, G).
        place: of the free numbers in the normal equations (C, G).
    """

    lobes: list[LobeSets]
    added: np.ndarray
    count: int
    value: np.ndarray
    scale: Numbers
    slope: np.ndarray
    factor: Numbers
    place: np.ndarray


@functools.lru_cache(maxsize=512)
def rows_of_candidate(terms: Terms, channels: int) -> CandidateRows | None:
    """Those of a candidate; None of one that is not of this form."""
    free = candidate_parameters(terms, channels).parameterisation
    if len(terms) > TERMS:
        return None
    place = np.append(np.argsort(free.order), -1)  # −1 stays: no number
    size = channels, len(free.free)
    made = CandidateRows(
        [], np.empty((0, 3), int), OWN, np.full((channels, TERMS), NOTHING), Numbers.ones(channels, TERMS),
        np.full(size, NOTHING), Numbers.ones(*size), place[free.columns],
    )  # fmt: skip
    for t, (term, of) in enumerate(zip(terms, term_columns(terms, channels), strict=True)):
        number = -1 if of.scale_number is None else place[of.scale_number]
        scale = np.broadcast_to(number, channels), of.scale if of.scale_number is None else 1.0
        grown = (_diffuse if term.model in DIFFUSE else _lobe)(made, t, term, of, place, scale)
        if grown is None:
            return None
        made = grown
    return dataclasses.replace(made, count=made.count - OWN)


Scale = tuple[np.ndarray, float]
"""Of each channel its place (C,), and what is known of it."""


def _diffuse(
    made: CandidateRows, t: int, term: TermSpec, of: TermColumns, place: np.ndarray, scale: Scale
) -> CandidateRows | None:
    """With an even diffuser, whose share is one more factor."""
    row, share = FRONT if DIFFUSE[term.model][1] else THROUGH, place[of.number[:, 0]]
    if (share >= 0).all():
        if (scale[0] >= 0).any():  # two free numbers in front of one row
            return None
        made.scale.set(np.s_[:, t], share, scale[1])
        known = scale[1]
    else:
        known = float(of.known[0])
        made.scale.set(np.s_[:, t], scale[0], scale[1] * known)
    made.value[:, t] = row
    for g, _ in of.slopes:
        made.slope[:, g] = row
        made.factor.set(np.s_[:, g], -1, known)
    return made


def _lobe(
    made: CandidateRows, t: int, term: TermSpec, of: TermColumns, place: np.ndarray, scale: Scale
) -> CandidateRows | None:
    """With a lobe."""
    (sets, shapes), first = of.number.shape, made.count
    rows = first + np.arange(sets * (1 + shapes)).reshape(sets, 1 + shapes)
    every = np.broadcast_to(rows, (len(made.value), 1 + shapes)) if sets == 1 else rows
    known = np.where(of.number >= 0, 1.0, of.known)
    made.lobes.append(LobeSets((lobe_of(term), of.names), Numbers(place[of.number], known), rows))
    made.value[:, t] = every[:, 0]
    made.scale.set(np.s_[:, t], *scale)
    count, added = first + rows.size, [made.added]
    for g, columns in of.slopes:
        if len(columns) > 2:
            return None
        made.slope[:, g] = every[:, 1 + columns[0]] if columns else every[:, 0]
        if columns:
            made.factor.set(np.s_[:, g], *scale)
        if len(columns) == 2:
            sums = count + np.arange(sets)
            added.append(np.stack([sums, *(rows[:, 1 + j] for j in columns)], axis=1))
            made.slope[:, g], count = sums, count + sets
    return dataclasses.replace(made, added=np.concatenate(added), count=count)


def runs(every: list[CandidateRows]) -> Iterator[tuple[CandidateRows, np.ndarray]]:
    """Neighbours that are the same, and which they are."""
    first = 0
    for k in range(1, len(every) + 1):
        if k == len(every) or every[k] is not every[first]:
            yield every[first], np.arange(first, k)
            first = k
