"""What pairs of readings that should be equal differ by, channel by channel: medians, bands of angles, χ²."""

import functools
import itertools
from typing import Any

import numpy as np

from gonio.checks.table.pairs.pairs import Column, Pairs
from gonio.checks.table.statistics.quantiles import median, quantiles
from gonio.data.angles import SLACK

FEWEST_KNOWN = 0.5
"""Share of the pairs that must have stored uncertainties for them to decide."""
BLOCK = 1 << 15
"""Pairs whose arrays stay in the processor's cache."""
LARGEST = 1e30
"""Of what is kept in single precision."""
STEP = 5
"""Degrees, of the bands of the larger polar angle."""


def parts_of(size: int) -> list[slice]:
    """Ranges of `BLOCK` of so many pairs."""
    return [slice(k, min(k + BLOCK, size)) for k in range(0, size, BLOCK)]


class Differences:
    """Relative differences 2|a − b|/(|a| + |b|) of pairs, and their squares in stated uncertainties.

    The numbers of all channels are kept in single precision.
    """

    def __init__(self, pairs: Pairs) -> None:
        self._pairs = pairs
        self._relative, self._squares = (np.full((pairs.channels, len(pairs)), np.nan, np.float32) for _ in range(2))
        self.comparable = np.zeros(len(pairs), bool)
        """(n,): whether both readings of any channel are valid."""
        self.by_channel = np.zeros(pairs.channels, int)
        """Pairs of each channel whose readings are both valid."""
        self.largest = 0.0
        self._lit = self._known = 0
        self._sums = np.zeros(3)

    def add(self, channel: int, column: Column) -> None:
        """The pairs of one more channel."""
        for part in parts_of(len(self._pairs)):
            self._add(channel, column.rows(part), part)

    def _add(self, channel: int, column: Column, part: slice) -> None:
        a, b, u_a, u_b, _ = column
        size, off, variance = np.abs(a) + np.abs(b), np.abs(a - b), u_a**2 + u_b**2
        comparable = np.isfinite(size)
        with np.errstate(divide="ignore", invalid="ignore"):
            relative, squares = 2 * off / size, np.minimum(off**2 / variance, LARGEST)
        if (nothing := size == 0).any():
            relative[nothing] = 0.0
        known = comparable & (variance > 0)
        dark = nothing & (u_a == 0) & (u_b == 0)
        squares[~known] = np.nan
        self._relative[channel, part], self._squares[channel, part] = relative, squares
        self.comparable[part] |= comparable
        self.by_channel[channel] += np.count_nonzero(comparable)
        self._lit += int(np.count_nonzero(comparable & ~dark))
        self.largest = max(self.largest, float(np.max(relative, initial=0.0, where=comparable)))
        self._known += int(np.count_nonzero(known))
        self._sums += [np.sum(squares, where=known), *(np.count_nonzero(squares > limit) for limit in (4, 9))]

    @property
    def decided_by_uncertainty(self) -> bool:
        """Whether the stored uncertainties of most pairs are known and not all zero; in the dark they may be."""
        return self._lit > 0 and self._known >= FEWEST_KNOWN * self._lit

    @property
    def median(self) -> float:
        """That of the relative differences of all channels."""
        return self._middle_and_most[0]

    @functools.cached_property
    def _middle_and_most(self) -> list[float]:
        return quantiles(self._relative, 0.5, 0.95)

    def facts(self) -> dict[str, Any]:
        """The medians by channel, the largest and the 95th percentile, and how the pairs scatter."""
        return {
            "median_by_channel": [median(of_channel) for of_channel in self._relative],
            "largest": self.largest,
            "percentile_95": self._middle_and_most[1],
            "interpolation_error": self._pairs.median_error,
            **self._scatter(),
        }

    def _scatter(self) -> dict[str, Any]:
        if not self._known:
            return {}
        mean, two, three = (float(s) / self._known for s in self._sums)
        return {
            "chi2_per_pair": mean,
            "share_beyond_2_sigma": two,
            "share_beyond_3_sigma": three,
            "pairs_with_uncertainty": self._known,
            # Half of the squares of a normal deviate are below 0.4549: few wrong pairs do not change it.
            "scatter_in_uncertainties": float(np.sqrt(median(self._squares) / 0.4549)),
        }

    def by_band(self) -> dict[str, list[float]]:
        """Median difference over bands of `STEP` degrees of the larger polar angle."""
        angles = self._pairs.angles
        band = (np.degrees(np.maximum(angles[:, 0], angles[:, 2]) + SLACK) // STEP).astype(np.int16)
        order = np.argsort(band, kind="stable")
        ends = np.searchsorted(band[order], np.arange(180 // STEP + 1))
        medians = [median(self._relative[:, order[low:high]]) for low, high in itertools.pairwise(ends)]
        known = {STEP * (k + 0.5): value for k, value in enumerate(medians) if np.isfinite(value)}
        return {"theta_deg": list(known), "median": list(known.values())}
