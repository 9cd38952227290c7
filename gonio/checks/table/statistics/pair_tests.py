"""Tests of single pairs of readings that should be equal, channel by channel: only what may decide is kept."""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from gonio.checks.table.pairs.pairs import Pairs
from gonio.checks.table.pairs.places import SIDE, bands
from gonio.checks.table.statistics.counts import (
    LIKELY,
    critical,
    deviates,
    difference_p,
    family_p,
    sidak,
)
from gonio.models.special.scipy_functions import ndtr

SizesOfPairs = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""What one count adds to readings a and b, 1/sr, of pairs of these numbers."""

KEPT = 100_000
"""Significant pairs beyond which those that cannot decide are dropped."""
ROUNDING = 2 * float(np.finfo(np.float32).eps)


class Rows(NamedTuple):
    """Pairs (n,) of one channel that can be tested, `pair` of all pairs."""

    a: np.ndarray
    b: np.ndarray
    u_a: np.ndarray
    u_b: np.ndarray
    uncertain: np.ndarray
    """How far b may be off by interpolation, and both by the decimals they are written with, 1/sr."""
    mean: np.ndarray
    sigma: np.ndarray
    pair: np.ndarray

    def where(self, some: np.ndarray) -> Self:
        """Some of them."""
        return type(self)(*(v[some] for v in self))

    @property
    def deviates(self) -> np.ndarray:
        """How many standard deviations a and b surely differ by."""
        return np.maximum(np.abs(self.a - self.b) - self.uncertain - ROUNDING * self.mean, 0.0) / self.sigma


class Strongest(NamedTuple):
    """The pair of the smallest p-value; of equal ones the first."""

    p: float
    pair: int
    channel: int


class Significant(NamedTuple):
    """Pairs (n,) that the level of the family may call wrong: p-values and relative violations."""

    p: np.ndarray
    over: np.ndarray
    pair: np.ndarray
    channel: np.ndarray

    def where(self, some: np.ndarray) -> Self:
        """Some of them."""
        return type(self)(*(v[some] for v in self))

    def violations(self, threshold: float) -> tuple[np.ndarray, np.ndarray]:
        """(least, half): the least violation that explains each at a level of one, and half of its interval's width."""
        limit = critical(threshold)
        share = limit / np.maximum(deviates(self.p), limit)
        return self.over * (1 - share), self.over * share


NONE = Significant(np.zeros(0), np.zeros(0), np.zeros(0, int), np.zeros(0, int))


class PairTests:
    """The tests of the pairs of all channels at the level of their family; the least p-value by square of angles."""

    def __init__(self, pairs: Pairs, level: float) -> None:
        self.level, self._most = level, len(pairs) * pairs.channels
        low, high = bands(pairs.angles).T
        self._square = low * SIDE + high
        self._angles = pairs.angles
        self.tests = np.zeros(pairs.channels, int)
        self.p_of_channel = np.ones(pairs.channels)
        self.strongest = Strongest(np.inf, 0, 0)
        self.first = (len(pairs), 0)
        """The first (pair, channel) that was tested."""
        self.significant = NONE
        self._count = np.zeros(SIDE * SIDE, int)
        self._smallest = np.ones(SIDE * SIDE)
        self._far: list[Rows] = []
        self._near = (-1.0, 0)

    @property
    def threshold(self) -> float:
        """The level of one test."""
        return sidak(self.level, int(self.tests.sum()))

    def add(self, channel: int, rows: Rows, interpolated: np.ndarray | None) -> None:
        """Some pairs of the channel; one `interpolated` partner proves nothing."""
        z, square = rows.deviates, self._square[rows.pair]
        if interpolated is not None:
            z[interpolated] = 0.0
        far = np.flatnonzero(z > LIKELY)
        if far.size:
            self._far.append(rows.where(far))
            z[far] = 0.0
        nearest = np.zeros(self._count.size)
        np.maximum.at(nearest, square, z)
        self._smallest = np.minimum(self._smallest, 2 * ndtr(-nearest))
        self._count += np.bincount(square, minlength=self._count.size)
        k = int(np.argmax(z))
        if z[k] > self._near[0]:
            self._near = float(z[k]), int(rows.pair[k])
        self.tests[channel] += z.size
        self.first = min(self.first, (int(rows.pair[0]), channel))

    def finish(self, channel: int, sizes: SizesOfPairs) -> None:
        """The end of a channel, of these sizes of counts: what differs by much is tested as counts are."""
        if not self.tests[channel]:
            return
        z, pair = self._near
        best = Strongest(float(2 * ndtr(-z)), pair, channel)
        if self._far:
            far = Rows(*(np.concatenate(parts) for parts in zip(*self._far, strict=True)))

            def p_values(rows: Rows) -> np.ndarray:
                allowed = rows.uncertain + ROUNDING * rows.mean
                return difference_p(rows.a, rows.b, rows.u_a, rows.u_b, *sizes(rows.pair), allowed)

            best = self._tested(channel, far, p_values, best)
        self._far, self._near = [], (-1.0, 0)
        self.p_of_channel[channel] = best.p
        self.strongest = min(self.strongest, best, key=lambda s: (s.p, s.pair, s.channel))

    def _tested(self, channel: int, far: Rows, p_values: Callable[[Rows], np.ndarray], best: Strongest) -> Strongest:
        """The p-values of those that may be the smallest of their square or of all, or significant."""
        # No count's tail is lighter than a normal one: what that leaves above the smallest yet is not computed.
        lower, square = 2 * ndtr(-far.deviates), self._square[far.pair]
        order = np.lexsort((lower, square))
        leading = order[np.diff(square[order], prepend=-1) != 0]
        leading = leading[(lower[leading] < self._smallest[square[leading]]) | (lower[leading] == lower.min())]
        p = np.full(lower.size, np.inf)
        for some in (leading, None):
            if some is None:
                least = max(min(best.p, float(p.min())), self.threshold)
                some = np.flatnonzero((lower < np.maximum(self._smallest[square], least)) & np.isinf(p))
            p[some] = p_values(far.where(some))
            np.minimum.at(self._smallest, square[some], p[some])
        k = np.flatnonzero(p == p.min())
        self._keep(channel, far, p)
        first = Strongest(float(p[k[0]]), int(far.pair[k].min()), channel)
        return min(best, first, key=lambda s: (s.p, s.pair))

    def _keep(self, channel: int, far: Rows, p: np.ndarray) -> None:
        some = np.flatnonzero(p < self.threshold)
        rows = far.where(some)
        over = np.maximum(np.abs(rows.a - rows.b) - rows.uncertain, 0.0) / rows.mean
        more = Significant(p[some], over, rows.pair, np.full(some.size, channel))
        kept = Significant(*(np.concatenate(pair) for pair in zip(self.significant, more, strict=True)))
        if kept.p.size > KEPT:
            # The final level of a test lies between that of all pairs and that of those tested so far.
            bounds = [kept.violations(t) for t in (self.threshold, sidak(self.level, self._most))]
            least = bounds[0][0] >= bounds[1][0].max()
            sure = bounds[1][0] > 0
            largest = kept.over + bounds[1][1] >= np.max((kept.over + bounds[0][1])[sure], initial=0.0)
            kept = kept.where(least | largest)
        self.significant = kept

    def p_map(self) -> tuple[np.ndarray, np.ndarray]:
        """(squares of the bands of both angles, of each the least p-value corrected for its tests), NaN for none."""
        shown = np.where(self._count > 0, family_p(self._smallest, np.maximum(self._count, 1)), np.nan)
        shown = shown.reshape(SIDE, SIDE)
        shown = np.where(np.isfinite(shown), shown, shown.T)
        used = np.flatnonzero(np.isfinite(shown).any(axis=1))
        return used, shown[np.ix_(used, used)]
