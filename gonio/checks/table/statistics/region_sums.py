"""Sums over the regions of pairs of readings that should be equal, channel by channel."""

import functools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gonio.checks.table.pairs.pairs import FEWEST, Pairs
from gonio.checks.table.pairs.places import SIDE, places
from gonio.checks.table.statistics.pair_tests import Rows

MOST_ROWS = 1 << 17
"""Pairs whose counts are held in memory at a time; a region of more is tested alone."""


class Region(NamedTuple):
    """The sums of a region, of one of the sizes of `Place` or of everywhere, in one channel."""

    size: str
    number: int
    sectors: np.ndarray
    """Numbers, of those of `RegionSums`, of the sectors that it consists of."""
    count: float
    z: float
    """Of the signed differences in standard deviations."""
    weight: float
    """Of the mean readings in standard deviations."""
    sharpness: float
    """Of one over the standard deviations, sr."""
    light: float
    """Of the mean readings with their signs, 1/sr."""
    uncertain: float
    """Of what is uncertain otherwise, in standard deviations."""

    @property
    def beyond(self) -> float:
        """The sum of the signed differences beyond what is uncertain, in its standard deviations."""
        return float(np.sign(self.z) * max(abs(self.z) - self.uncertain, 0.0) / np.sqrt(self.count))


class RegionSums:
    """Sums of the pairs of known sign, `sign` (n,)."""

    def __init__(self, pairs: Pairs, sign: np.ndarray) -> None:
        self._sectors, number = np.unique(places(pairs.angles).sector, return_inverse=True)
        signed = sign != 0
        self.number = np.where(signed, number.reshape(-1), self._sectors.size).astype(np.int32)
        """(n,): the sector of each pair; one more for those of unknown sign."""
        self.sign = None if signed.all() and (sign > 0).all() else sign.astype(np.int8)
        """(n,), or None where all are positive."""
        self._sums = np.zeros((6, self._sectors.size + 1))

    @functools.cached_property
    def _by_sector(self) -> tuple[np.ndarray, np.ndarray]:
        """(numbers of all pairs, sector by sector; where each sector begins among them)."""
        order = np.argsort(self.number, kind="stable").astype(np.int32)
        return order, np.searchsorted(self.number[order], np.arange(self._sectors.size + 1))

    def pairs_of(self, region: Region) -> np.ndarray:
        """Numbers (n,) of the pairs of a region, of those that were added and those that could not be."""
        order, starts = self._by_sector
        return np.concatenate([order[starts[k] : starts[k + 1]] for k in region.sectors])

    def batches(self, some: list[int], regions: list[Region]) -> Iterator[list[int]]:
        """Some of the regions in turn, so many that they have at most `MOST_ROWS` pairs together; one at least."""
        batch, rows = list[int](), 0.0
        for k in some:
            if batch and rows + regions[k].count > MOST_ROWS:
                yield batch
                batch, rows = [], 0.0
            batch.append(k)
            rows += regions[k].count
        if batch:
            yield batch

    def add(self, rows: Rows, certain: bool) -> None:
        """Some pairs of the present channel; `certain`: none of them is uncertain but by noise."""
        number = self.number[rows.pair]
        z = (rows.a - rows.b) / rows.sigma
        weights = [None, z if self.sign is None else z * self.sign[rows.pair], rows.mean / rows.sigma]
        weights += [1 / rows.sigma, (rows.a + rows.b) / 2]
        weights += [] if certain else [rows.uncertain / rows.sigma]
        for sums, weight in zip(self._sums, weights, strict=False):
            sums += np.bincount(number, weight, sums.size)

    def finish(self) -> list[Region]:
        """The regions of the channel that hold `FEWEST` pairs, from the smallest to everywhere; the next one begins."""
        sums, regions, squares = self._sums[:, :-1], [], self._sectors // 100
        levels = {"sector": self._sectors, "square": squares, "band": squares // SIDE, "everywhere": 0 * squares}
        for size, numbers in levels.items():
            present, place = np.unique(numbers, return_inverse=True)
            of_level = np.stack([np.bincount(place.reshape(-1), s, present.size) for s in sums], axis=1)
            for k in np.flatnonzero(of_level[:, 0] >= FEWEST):
                sectors = np.flatnonzero(numbers == present[k])
                regions.append(Region(size, int(present[k]), sectors, *(float(s) for s in of_level[k])))
        self._sums = np.zeros_like(self._sums)
        return regions
