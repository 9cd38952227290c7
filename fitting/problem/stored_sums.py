"""Normal equations over the readings of a large table, which stay in it: the sums of one piece after another."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.compiled_sums import BoundSums, Sums
from gonio.fitting.problem.disc_averages import Samples, block_rules, disc_rules
from gonio.fitting.problem.readings import ALIGNED, POINTS, Readings, block_shape, in_blocks
from gonio.models.geometry.directions import NORMAL, Direction

KEPT = 96 << 20
"""Bytes of pieces that are kept, and need not be read again."""


class Piece(NamedTuple):
    """The samples of a piece, how many are in use, and whether they are kept."""

    samples: Samples
    number: int
    kept: bool


class _Store:
    """Memory for what is kept, in one piece: between arrays that stay, those that are forgotten would leave holes."""

    def __init__(self, size: int) -> None:
        """Of so many bytes, which take no memory before they are used."""
        raw = np.empty(size + ALIGNED, np.uint8)
        start = -raw.ctypes.data % ALIGNED
        self._all, self._next = raw[start : start + size].view(np.float64), 0

    def taken(self, sizes: Sequence[int]) -> list[np.ndarray] | None:
        """Arrays of so many numbers, aligned; None where there is no room for them."""
        rounded = [-(-n // ALIGNED) * ALIGNED for n in sizes]
        ends = [*itertools.accumulate(rounded, initial=self._next)]
        if ends[-1] > self._all.size:
            return None
        self._next = ends[-1]
        return [self._all[first : first + n] for first, n in zip(ends, sizes, strict=False)]

    def holds(self, a: np.ndarray) -> bool:
        """Whether an array is one of those."""
        return np.may_share_memory(a, self._all)


class Pieces:
    """The samples of readings that stay in their table, block by block; those that come first are kept."""

    def __init__(self, readings: Readings, targets: np.ndarray, weight: np.ndarray, floor: float) -> None:
        """Of readings, T(y c) and weights, all deferred, and the floor of the loss."""
        assert readings.rows is not None
        self._rows = readings.rows
        self._readings, self._targets, self._weight, self._floor = readings, targets, weight, np.asarray(floor)
        self._spans, self._kept, self._store = list(readings.rows.spans), dict[int, Piece](), _Store(KEPT)
        self._ones = np.zeros(0)

    def __iter__(self) -> Iterator[Piece]:
        """All pieces in turn."""
        for k, span in enumerate(self._spans):
            piece = self._kept.get(k)
            if piece is None:
                piece = self._piece(span)
                if piece.kept:
                    self._kept[k] = piece
                    wi, wo = (Direction(*(c.reshape(-1)[: piece.number] for c in w)) for w in piece.samples[:2])
                    self._rows.keep_directions(span, wi, wo)
            yield piece

    def _piece(self, span: slice) -> Piece:
        n, channels = span.stop - span.start, self._weight.shape[1]
        shape = block_shape(n, channels)
        cells, values, weight = (*shape,), (*shape, channels), self._weight[span]
        ones = weight[0, 0] == 1.0 and bool((weight == 1.0).all())
        sizes = [math.prod(cells)] * 6 + [math.prod(values)] * (1 if ones else 2)
        laid = iter(self._store.taken(sizes) or [None] * len(sizes))
        wi, wo = (
            Direction(*(in_blocks(np.asarray(c), cells, e, into=next(laid)) for c, e in zip(w, NORMAL, strict=True)))
            for w in self._readings.directions(span)
        )
        target = in_blocks(self._targets[span], values, into=next(laid))
        weight = self._one_each(n, values) if ones else in_blocks(weight, values, into=next(laid))
        used = np.asarray(-(-n // shape[1]))
        blocks = block_rules(None, shape[0])
        samples = Samples(wi, wo, target, weight, used, self._floor, blocks, disc_rules(POINTS))
        return Piece(samples, n, self._store.holds(target))

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
