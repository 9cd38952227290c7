"""The family of tests of all pairs and regions of readings that should be equal, gathered channel by channel."""

import dataclasses
import functools
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.certificate import place_of
from gonio.checks.table.dark_regions import light_of_open_regions
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs.pairs import Column, Pairs
from gonio.checks.table.regions import region_place
from gonio.checks.table.statistics.count_sizes import CountSizes
from gonio.checks.table.statistics.counts import (
    LIKELY,
    critical,
    decimal_step,
    deviates,
    family_p,
    normal_p,
    sidak,
)
from gonio.checks.table.statistics.differences import LARGEST, parts_of
from gonio.checks.table.statistics.pair_tests import PairTests, Rows, SizesOfPairs
from gonio.checks.table.statistics.quantiles import median
from gonio.checks.table.statistics.region_sums import Region, RegionSums
from gonio.checks.table.statistics.sum_tests import Counted, sums_p

DARK = 2.0
"""Relative difference of a reading and of one that is dark."""
SOME = 2000
"""Values of a channel by which it is seen that they were not rounded."""


class Violation(NamedTuple):
    """An estimate of a relative violation, half of the width of its interval at the level, and its place."""

    estimate: float
    half: float
    where: dict[str, Any]

    @property
    def largest(self) -> float:
        """The upper end of the interval; no readings of light differ by more than one of them being dark."""
        return min(self.estimate + self.half, max(DARK, self.estimate))


@dataclasses.dataclass(frozen=True)
class _Regions:
    """Tests of the regions, (n,): p-values and relative violations, with the places."""

    p: np.ndarray
    estimate: np.ndarray
    half: np.ndarray
    """Half of the width of the interval of the violation, at the level."""
    least: np.ndarray
    """The least violation that explains the readings at the level; 0 where none is needed."""
    absolute: np.ndarray
    """What readings may differ by on average at the level, 1/sr."""
    channel: np.ndarray
    where: list[dict[str, Any]]
    """What a certificate calls them."""

    @property
    def largest(self) -> np.ndarray:
        """The upper ends of the intervals."""
        return np.abs(self.estimate) + self.half

    @property
    def family(self) -> float:
        """The p-value of all of them together."""
        return float(family_p(self.p.min(), self.p.size)) if self.p.size else 1.0


class LevelTests:
    """The family of tests of all pairs and regions at the level of the evidence, gathered channel by channel.

    `sign` (n,) is that of a violation in each pair; 0 where it is unknown.
    """

    def __init__(self, evidence: TableEvidence, pairs: Pairs, sign: np.ndarray) -> None:
        self._evidence, self._pairs = evidence, pairs
        self._step = _step_of(pairs)
        self.single, self._sums = PairTests(pairs, evidence.level / 2), RegionSums(pairs, sign)
        self._sizes: CountSizes | None = None
        self._tested: list[tuple[Region, int, float]] = []
        self._relative = np.full((pairs.channels, len(pairs)), np.nan, np.float32)
        self._z2 = 0.0

    def add(self, channel: int, column: Column) -> None:
        """The pairs of one more channel."""
        for part in parts_of(len(self._pairs)):
            self._add(channel, column.rows(part), part.start)
        if self.single.tests[channel]:
            self._sizes = self._sizes or _count_sizes(self._pairs)
            known = self._sizes.of((column.a, column.u_a), (column.b, column.u_b))

            def sizes(pair: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                return known.of_readings(pair), known.of_readings(pair + column.a.size)

            self.single.finish(channel, sizes)
            regions = self._sums.finish()
            self._tested += zip(regions, [channel] * len(regions), self._p_of(regions, column, sizes), strict=True)

    def _p_of(self, regions: list[Region], column: Column, sizes: SizesOfPairs) -> np.ndarray:
        """The p-values (R,) of the means of the signed standardised differences of regions."""
        z = np.array([region.beyond for region in regions])
        p = normal_p(z)
        for batch in self._sums.batches([k for k in range(z.size) if abs(z[k]) > LIKELY], regions):
            pairs = [self._usable(regions[k], column) for k in batch]
            pair = np.concatenate(pairs)
            rows, (q_a, q_b) = column.rows(pair), sizes(pair)
            a, b = Counted(rows.a, rows.u_a, q_a), Counted(rows.b, rows.u_b, q_b)
            if self._sums.sign is not None:
                b_larger = self._sums.sign[pair] < 0
                a, b = (
                    Counted(*(np.where(b_larger, y, x) for x, y in zip(*two, strict=True))) for two in ((a, b), (b, a))
                )
            p[batch] = sums_p(z[batch], np.array([pair.size for pair in pairs]), a, b)
        return p

    def _usable(self, region: Region, column: Column) -> np.ndarray:
        """Numbers of the pairs of a region that can be tested."""
        some = self._sums.pairs_of(region)
        a, b, u_a, u_b, _ = column.rows(some)
        variance = u_a**2 + u_b**2
        return some[np.isfinite(a) & np.isfinite(b) & np.isfinite(variance) & (variance > 0)]

    def _add(self, channel: int, column: Column, start: int) -> None:
        a, b, u_a, u_b, error = column
        size, variance = np.abs(a) + np.abs(b), u_a**2 + u_b**2
        usable = np.isfinite(size) & np.isfinite(variance) & (variance > 0)
        pair = np.arange(start, start + size.size) if usable.all() else start + (some := np.flatnonzero(usable))
        if pair.size < size.size:
            (a, b, u_a, u_b, error), size, variance = column.rows(some), size[some], variance[some]
        if not pair.size:
            return
        mean, sigma = np.maximum(size / 2, 1e-300), np.sqrt(variance)
        uncertain, interpolated = np.broadcast_to(self._step, mean.shape), None
        if isinstance(error, np.ndarray):
            uncertain, interpolated = error * mean + self._step, error > 0
        rows = Rows(a, b, u_a, u_b, uncertain, mean, sigma, pair)
        self.single.add(channel, rows, interpolated)
        self._sums.add(rows, interpolated is None and not self._step)
        self._relative[channel, pair] = np.minimum(sigma / mean, LARGEST)
        self._z2 += float(np.sum(((a - b) / sigma) ** 2))

    @property
    def tests(self) -> int:
        """Pairs that were tested, of all channels."""
        return int(self.single.tests.sum())

    @property
    def level(self) -> float:
        """Of pairs and regions together."""
        return self._evidence.level

    @functools.cached_property
    def regions(self) -> _Regions:
        """The tests of the regions: of the mean of the signed standardised differences, and what it makes of the mean.

        All weights come from the uncertainties, none from readings, so that no noise is in them.
        """
        regions = [region for region, _, _ in self._tested]
        count, z, weight, sharpness, _, error = np.array([r[3:] for r in regions]).reshape(-1, 6).T
        estimate, one, error = z / weight, np.sqrt(count) / weight, error / weight
        estimate = np.sign(estimate) * np.maximum(np.abs(estimate) - error, 0)
        p = np.array([p for *_, p in self._tested])
        limit = critical(sidak(self.single.level, p.size))
        half = np.maximum(limit * one, np.abs(estimate) * np.minimum(limit / np.maximum(deviates(p), 1e-9), 1.0))
        least, channels = np.maximum(np.abs(estimate) - half, 0.0), [channel for _, channel, _ in self._tested]
        where = [
            region_place(r.size, r.number, self._evidence.channel(channel))
            for r, channel in zip(regions, channels, strict=True)
        ]
        half = half + error
        absolute = (np.abs(estimate) + half) * weight / sharpness
        return _Regions(p, estimate, half, least, absolute, np.array(channels, int), where)

    def everywhere(self) -> Violation:
        """Without signs: the root mean square violation that the mean of z² leaves, and its limit (normal in n)."""
        noise, more = median(self._relative), max(self._z2 / self.tests - 1, 0.0)
        highest = more + critical(self.level) * np.sqrt(2 * (1 + 2 * more) / self.tests)
        return Violation(noise * np.sqrt(more), noise * (np.sqrt(highest) - np.sqrt(more)), {})

    @property
    def detectable(self) -> float:
        """The violation that a single pair would show, the median."""
        return critical(self.single.threshold) * median(self._relative)

    def strongest(self) -> tuple[float, float, dict[str, Any]]:
        """(p of its family, its own p, its place) of the strongest pair or region, of the family that is stronger."""
        best = self.single.strongest
        family = float(family_p(best.p, self.tests))
        if self.regions.p.size and self.regions.family < family:
            k = int(np.argmin(self.regions.p))
            return self.regions.family, float(self.regions.p[k]), self.regions.where[k]
        return family, best.p, self._place(best.pair, best.channel)

    def least(self) -> tuple[float, dict[str, Any]]:
        """The least violation that explains the readings, and where: the largest that a pair or region needs."""
        least, _ = self.single.significant.violations(self.single.threshold)
        k = int(np.argmax(least)) if least.max(initial=0.0) > 0 else None
        alone = 0.0 if k is None else float(least[k])
        if self.regions.p.size and self.regions.least.max() > alone:
            k = int(np.argmax(self.regions.least))
            return float(self.regions.least[k]), self.regions.where[k]
        if k is None:
            return 0.0, self._place(*self.single.first)
        return alone, self._place(int(self.single.significant.pair[k]), int(self.single.significant.channel[k]))

    def dark(self, tolerance: float) -> tuple[float, float]:
        """What regions that are open at a tolerance may hide: see `light_of_open_regions`; (0, 0) where none is."""
        tested, regions = self._tested, self.regions
        worst = [(0.0, 0.0)]
        for channel in np.unique(regions.channel[regions.largest > tolerance]):
            some = np.flatnonzero(regions.channel == channel)
            of_channel = light_of_open_regions(
                [tested[k][0] for k in some], regions.largest[some] > tolerance, regions.absolute[some]
            )
            worst.append(of_channel.worst(tolerance))
        return max(worst)

    def widest(self, most: float = np.inf) -> Violation:
        """The largest violation that is not excluded: of a region, or of a pair that needs one.

        `most`: regions where more is not excluded are left out.
        """
        widest = self.everywhere()
        if (some := np.flatnonzero(self.regions.largest <= most)).size:
            k = int(some[np.argmax(self.regions.largest[some])])
            widest = Violation(float(abs(self.regions.estimate[k])), float(self.regions.half[k]), self.regions.where[k])
        pairs = self.single.significant
        least, half = pairs.violations(self.single.threshold)
        if least.max(initial=0.0) > 0:
            k = int(np.argmax(np.where(least > 0, pairs.over + half, -1.0)))
            place = self._place(int(pairs.pair[k]), int(pairs.channel[k]))
            alone = Violation(float(pairs.over[k]), float(half[k]), place)
            widest = max(widest, alone, key=lambda violation: violation.largest)
        return widest

    def p_of_channel(self, channel: int) -> float | None:
        """The p-value of the tests of a channel; None where it has none."""
        ps = []
        if self.single.tests[channel]:
            ps.append(float(family_p(self.single.p_of_channel[channel], self.single.tests[channel])))
        if (p := self.regions.p[self.regions.channel == channel]).size:
            ps.append(float(family_p(p.min(), p.size)))
        return float(family_p(min(ps), len(ps))) if ps else None

    def _place(self, pair: int, channel: int) -> dict[str, Any]:
        return place_of(self._pairs.angles[pair], self._evidence.channel(channel))


def _step_of(pairs: Pairs) -> float:
    """The decimal to which the readings were rounded; two rounded readings differ by up to a whole step more."""
    steps = []
    for column in pairs.columns():
        values = np.concatenate([column.a, column.b])
        known = values[np.isfinite(values)]
        some = known[:: max(known.size // SOME, 1)]
        if np.unique(some).size >= SOME // 2 and not decimal_step(some):
            return 0.0  # so it is with most tables, and with the first of their channels
        steps.append(np.unique(known))
    return decimal_step(np.concatenate(steps)) if steps else 0.0


def _count_sizes(pairs: Pairs) -> CountSizes:
    """Of the readings a and then b; each pair of sides by itself: between media what goes through is scaled."""
    theta_i, theta_o = np.concatenate(pairs.theta_i), np.concatenate(pairs.theta_o)
    return CountSizes(theta_i, 2 * (theta_i > np.pi / 2) + (theta_o > np.pi / 2))
