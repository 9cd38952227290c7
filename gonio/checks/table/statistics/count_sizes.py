"""What one count of photons adds to a reading, by the readings alone."""

import numpy as np

from gonio.checks.table.statistics.quantiles import stable_order

SAME_THETA = 1e-6
"""Difference, radians, of polar angles that are one."""

GROUP = 32
"""Readings, alike in their uncertainty, from which the size of a count is taken."""

MOST_LIT = 0.75
"""Share of a group's readings above their uncertainty from which these are of some counts each."""

CERTAIN = 3.0
"""Standard deviations by which the signal of a group may be too large by chance."""


class CountSizes:
    """What one count adds to a reading, 1/sr, at each of n readings at polar angles of incidence `theta`, radians.

    Counts make u² = quantum · f + more: the least of Σu²/Σf over groups of readings of one `kind` at a like incidence
    that are alike in u, each with its upper limit, so that a group of few counts makes it no smaller. It is an upper
    bound: other noise makes it larger, and with it the tails. 0 where all f are 0, and where f or u is unknown or u 0.
    """

    def __init__(self, theta: np.ndarray, kind: np.ndarray | int) -> None:
        nodes = np.unique(theta)
        new = np.diff(nodes, prepend=nodes[:1]) > SAME_THETA
        of_theta = np.cumsum(new)[np.searchsorted(nodes, theta)]
        self._angles = int(of_theta.max(initial=0)) + 1
        number = kind * self._angles + of_theta
        self._theta, self._number = theta, number.astype(np.int16 if number.max(initial=0) < 1 << 15 else np.int32)
        # Of small integers the order takes no comparisons.
        self._order = np.argsort(self._number, kind="stable").astype(np.int32)

    def of(self, *parts: tuple[np.ndarray, np.ndarray]) -> "KnownSizes":
        """Those by the readings of one channel: f and their uncertainties u, in parts that make n together."""
        return KnownSizes(self, parts)

    def ordered(self, ok: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(numbers of some of the readings, group by group; where each group begins and the last one ends)."""
        order = self._order if ok.all() else self._order[ok[self._order]]
        return order, np.array([*self._starts(self._number[order]), order.size])

    def slant(self, some: np.ndarray) -> np.ndarray:
        """Light that arrives aslant is spread over more of the surface: one count stands for as much more."""
        return np.maximum(np.abs(np.cos(self._theta[some])), 1e-6)

    def number(self, some: np.ndarray) -> np.ndarray:
        """A number that readings of one kind at one incidence share."""
        return self._number[some]

    def _starts(self, number: np.ndarray) -> list[int]:
        """Where groups begin: whole incidences of one kind together until they have enough readings."""
        starts = [0]
        for edge in np.flatnonzero(np.diff(number)) + 1:
            new_kind = number[edge] // self._angles != number[edge - 1] // self._angles
            if new_kind or edge - starts[-1] >= GROUP:
                starts.append(int(edge))
        return starts


class KnownSizes:
    """`CountSizes` of one channel, computed incidence by incidence where they are asked for."""

    def __init__(self, sizes: CountSizes, parts: tuple[tuple[np.ndarray, np.ndarray], ...]) -> None:
        self._sizes, self._parts = sizes, parts
        self._ok = np.concatenate([np.isfinite(f) & (u > 0) & np.isfinite(u) for f, u in parts])
        self._order, self._ends = sizes.ordered(self._ok)
        first = sizes.number(self._order[self._ends[:-1]]) if self._order.size else np.zeros(0, int)
        self._first, self._known = first, np.full(first.size, np.nan)

    def of_readings(self, wanted: np.ndarray) -> np.ndarray:
        """Those of the readings of these numbers, 1/sr."""
        group = np.searchsorted(self._first, self._sizes.number(wanted), side="right") - 1
        ok = self._ok[wanted]
        for k in np.unique(group[ok]):
            if np.isnan(self._known[k]):
                some = self._order[self._ends[k] : self._ends[k + 1]]
                (f, u), slant = self._readings(some), self._sizes.slant(some)
                self._known[k] = _least_count(slant * f, slant * u**2 * slant)
        return (
            np.where(ok, self._known[group], 0.0) / self._sizes.slant(wanted) if self._known.size else np.zeros(ok.size)
        )

    def _readings(self, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        f, u = np.empty(some.size), np.empty(some.size)
        start = 0
        for part_f, part_u in self._parts:
            there = (some >= start) & (some < start + part_f.size)
            number = some[there] - start
            f[there], u[there] = part_f[number], part_u[number]
            start += part_f.size
        return f, u


def _least_count(signal: np.ndarray, variance: np.ndarray) -> float:
    """The least upper limit of Σvariance/Σsignal of groups alike in variance, or of all; else the smallest signal.

    Where few readings of a group exceed their uncertainty, counts may be so rare that one alone is its signal: there
    the variance is no less than its readings scatter.
    """
    alike = stable_order(variance)
    signal, variance = signal[alike], variance[alike]
    firsts = np.arange(0, alike.size, GROUP)
    lit = (signal > np.sqrt(variance)).astype(float)
    for starts in (firsts, firsts[:1]):
        v, s, squares, bright = (np.add.reduceat(a, starts) for a in (variance, signal, signal**2, lit))
        number = np.diff(np.append(starts, alike.size))
        scatter = (squares - s**2 / number) * number / np.maximum(number - 1, 1)
        v = np.where(bright >= MOST_LIT * number, v, np.maximum(v, scatter))
        surely = s - CERTAIN * np.sqrt(v)
        if (surely > 0).any():
            return float(np.min(v[surely > 0] / surely[surely > 0]))
    # Hardly anything was met: a reading is a count or two.
    return float(np.min(np.abs(signal[signal != 0]), initial=np.inf)) if (signal != 0).any() else 0.0
