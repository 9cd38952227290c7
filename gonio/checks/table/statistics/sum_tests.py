"""Tests of sums of standardised differences, one for each region, where a reading may be a count of photons."""

from typing import NamedTuple

import numpy as np
from scipy.special import exprel, ndtr

from gonio.checks.table.statistics.counts import FARTHEST, normal_p, second_order, standard_counts

COARSE = 0.1
"""Standard deviations of a sum that one count makes, above which its tail has steps."""
STEPS = 100
"""Five or six are usual, 50 the most that are needed."""
ENOUGH = 1e-9
"""Of the tilt of a sum, at which its tail is stationary."""


class Counted(NamedTuple):
    """Readings (n,), 1/sr: their values, standard uncertainties, and what one count adds to each."""

    f: np.ndarray
    u: np.ndarray
    count: np.ndarray


def sums_p(z: np.ndarray, sizes: np.ndarray, up: Counted, down: Counted) -> np.ndarray:
    """Two-sided p-values (R,) of sums of standardised differences of readings that are expected to be the same.

    Where a single count makes much of a sum it is Chernoff's bound, elsewhere the normal tail or the saddlepoint's.

    Args:
        z: each sum, over the root of its number of differences, (R,).
        sizes: how many differences each sum has, at least 1, (R,): the first sum has the first ones.
        up, down: the reading that counts upwards in each difference, and the other one.

    References:
        Lugannani & Rice 1980, Adv. Appl. Probab. 12, 475, for the saddlepoint's tail; Chernoff 1952, Ann. Math. Stat.
        23, 493, for the bound.
    """
    (a, u_a, q_a), (b, u_b, q_b) = up, down
    mean = np.maximum((a * u_b**2 + b * u_a**2) / (u_a**2 + u_b**2), 0.0)
    of_up = _tails(np.abs(z), sizes, standard_counts(u_a, u_b, q_a, q_b, mean))
    of_down = _tails(np.abs(z), sizes, standard_counts(u_b, u_a, q_b, q_a, mean))
    return np.clip(of_up + of_down, normal_p(z), 1.0)


class _Generating:
    """The cumulant generating functions of some sums, in their standard deviations."""

    def __init__(self, sizes: np.ndarray, v: np.ndarray, q: np.ndarray) -> None:
        """Of sums of so many differences (R,), whose counts have variances v and sizes q, (4, n)."""
        self._sum = np.repeat(np.arange(sizes.size), sizes)
        self._starts, self.v, self.q = np.cumsum(sizes) - sizes, v, q

    def where(self, some: np.ndarray) -> "_Generating":
        """Those of some of the sums, a mask."""
        rows = some[self._sum]
        sizes = np.bincount(self._sum, minlength=some.size)[some]
        return _Generating(sizes, self.v[:, rows], self.q[:, rows])

    def tilted(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative at t, (R,) each."""
        y = self.q * t[self._sum]
        return t * self._total(self.v * exprel(y)), self._total(self.v * np.exp(y))

    def value(self, t: np.ndarray) -> np.ndarray:
        """At t, (R,)."""
        return t**2 * self._total(self.v * second_order(self.q * t[self._sum]))

    def largest(self) -> np.ndarray:
        """The largest size of a count of each sum, (R,)."""
        return np.maximum.reduceat(self.q.max(axis=0), self._starts)

    def _total(self, values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values.sum(axis=0), self._starts)


def _tails(
    z: np.ndarray, sizes: np.ndarray, counts: tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]
) -> np.ndarray:
    """One-sided tails (R,) beyond z of sums of counts."""
    number = np.repeat(sizes, sizes)
    whole = _Generating(sizes, np.stack(counts[0]) / number, np.stack(counts[1]) / np.sqrt(number))
    largest = whole.largest()
    coarse = largest > COARSE
    x = np.where(coarse, z, np.minimum(z, FARTHEST))
    t = _roots(whole, x, z, 600 / np.maximum(largest, 1e-3))
    w2 = np.maximum(2 * (t * x - whole.value(t)), 1e-12)
    w, u = np.sqrt(w2), t * np.sqrt(whole.tilted(t)[1])
    with np.errstate(invalid="ignore", divide="ignore"):  # of the coarse ones
        fine = ndtr(-w) + np.exp(-w2 / 2) / np.sqrt(2 * np.pi) * (1 / u - 1 / w)
    return np.where(coarse, np.exp(-w2 / 2), fine)


def _roots(whole: _Generating, x: np.ndarray, start: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Where the slopes are x, in [0, most]: by Newton's steps while each is half the last, else by bisection."""
    t, out = np.minimum(start, most), np.empty(x.size)
    low, high, step, place = np.zeros(x.size), most, most, np.arange(x.size)
    for _ in range(STEPS):
        first, slope = whole.tilted(t)
        below = first < x
        low, high = np.where(below, t, low), np.where(below, high, t)
        newton = np.divide(x - first, slope, out=np.full(t.size, np.inf), where=(slope > 0) & np.isfinite(slope))
        fast = (low < t + newton) & (t + newton < high) & (2 * np.abs(newton) <= np.abs(step))
        step = np.where(fast, newton, (low + high) / 2 - t)
        t = t + step
        out[place] = t
        go = np.abs(step) > ENOUGH * np.abs(t)
        if not go.any():
            break
        if not go.all():
            whole, place = whole.where(go), place[go]
            t, low, high, step, x = (v[go] for v in (t, low, high, step, x))
    return out
