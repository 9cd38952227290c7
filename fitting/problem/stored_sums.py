"""Normal equations over the readings of a large table, which stay in it: the sums of one piece after another."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.compiled_sums import BoundSums, Sums
from gonio.fitting.problem.disc_averages import Samples, block_rules, program_rules
from gonio.fitting.problem.readings import POINTS, Readings, block_shape, in_blocks
from gonio.models.geometry.directions import NORMAL, Direction

KEPT = 96 << 20
"""Bytes of pieces that are kept, and need not be read again."""


class Piece(NamedTuple):
    """The samples of a piece, how many are in use, and whether they are kept."""

    samples: Samples
    number: int
    kept: bool


class Pieces:
    """The samples of readings that stay in their table, block by block; those that come first are kept."""

    def __init__(self, readings: Readings, targets: np.ndarray, weight: np.ndarray, floor: float) -> None:
        """Of readings, T(y c) and weights, all deferred, and the floor of the loss."""
        assert readings.rows is not None
        self._rows = readings.rows
        self._readings, self._targets, self._weight, self._floor = readings, targets, weight, np.asarray(floor)
        self._spans, self._kept, self._room = list(readings.rows.spans), dict[int, Piece](), KEPT
        self._ones = np.zeros(0)

    def __iter__(self) -> Iterator[Piece]:
        """All pieces in turn."""
        for k, span in enumerate(self._spans):
            piece = self._kept.get(k)
            if piece is None:
                piece = self._piece(span)
                target, weight = np.asarray(piece.samples.target), np.asarray(piece.samples.weight)
                size = 6 * piece.samples.wi.z.nbytes + target.nbytes
                size += 0 if weight.base is self._ones else weight.nbytes
                if size <= self._room:
                    self._room -= size
                    piece = self._kept[k] = piece._replace(kept=True)
                    wi, wo = (Direction(*(c.reshape(-1)[: piece.number] for c in w)) for w in piece.samples[:2])
                    self._rows.keep_directions(span, wi, wo)
            yield piece

    def _piece(self, span: slice) -> Piece:
        n, channels = span.stop - span.start, self._weight.shape[1]
        shape = block_shape(n, channels)
        wi, wo = (
            Direction(*(in_blocks(np.asarray(c), shape, e) for c, e in zip(w, NORMAL, strict=True)))
            for w in self._readings.directions(span)
        )
        target, weight = in_blocks(self._targets[span], (*shape, channels)), self._weight[span]
        ones = weight[0, 0] == 1.0 and bool((weight == 1.0).all())
        weight = self._one_each(n, (*shape, channels)) if ones else in_blocks(weight, (*shape, channels))
        used = np.asarray(-(-n // shape[1]))
        discs = program_rules(POINTS)
        samples = Samples(wi, wo, target, weight, used, self._floor, block_rules(None, shape[0]), discs)
        return Piece(samples, n, False)

    def _one_each(self, n: int, shape: tuple[int, int, int]) -> np.ndarray:
        """Weights of 1 for n samples, and 0 beyond them: a part of an array that serves all pieces."""
        used, whole = n * shape[2], math.prod(shape)
        if self._ones.size < 2 * whole:
            self._ones = np.repeat([1.0, 0.0], whole)
        first = self._ones.size // 2 - used
        return self._ones[first : first + whole].reshape(shape)


class StoredSums:
    """The sums over all pieces."""

    def __init__(self, bound: Callable[[Samples, int], BoundSums], pieces: Pieces) -> None:
        """Of what makes the sums of samples, so many in use."""
        self._make, self._pieces, self._kept = bound, pieces, dict[int, BoundSums]()

    def _bound(self) -> Iterator[BoundSums]:
        for k, piece in enumerate(self._pieces):
            bound = self._kept.get(k) or self._make(piece.samples, piece.number)
            if piece.kept:
                self._kept[k] = bound
            yield bound

    def pairs(self, p: np.ndarray) -> np.ndarray | None:
        """As `BoundSums.pairs`."""
        return _added(bound.pairs(p) for bound in self._bound())

    def __call__(self, p: np.ndarray, full: bool) -> Sums | None:
        """As of `BoundSums`, without f."""
        if full:
            squares = self.scored(p)
        else:
            each = (bound(p, False) for bound in self._bound())
            squares = _added(None if sums is None else sums.squares for sums in each)
        return None if squares is None else Sums(squares, None)

    def scored(self, p: np.ndarray) -> np.ndarray | None:
        """As `BoundSums.scored`."""
        return _added(bound.scored(p) for bound in self._bound())


def _added(parts: Iterable[np.ndarray | None]) -> np.ndarray | None:
    """The sum of parts, None where one of them is."""
    total = None
    for part in parts:
        if part is None:
            return None
        total = part if total is None else total + part
    return total
