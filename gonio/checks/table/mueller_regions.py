"""Mueller matrices of a table block by block, and their means and noise over regions of directions."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import NamedTuple, Self

import numpy as np

from gonio.checks.table.pairs.places import BLOCK, angles_of
from gonio.data.flags import Flag
from gonio.data.table import Table

SIZES = ((10, 30), (30, 90), (90, 360))
"""Of regions, degrees: of both polar angles, and of the azimuth difference; the first that hold enough readings."""
FEWEST = 4
"""Matrices of a region from whose scatter its noise is taken, where no uncertainties are stored."""
DARK = 1e-3
"""Matrices darker than this share of the median weigh less in means."""


class Matrices(NamedTuple):
    """Some readings: numbers of the cells (n,), elements and their uncertainties (n, 16), row by row; 0 for unread."""

    cells: np.ndarray
    elements: np.ndarray
    u: np.ndarray


def matrices_in_blocks(table: Table, channels: Mapping[tuple[int, int], int]) -> Iterator[Matrices]:
    """The Mueller matrices of which every element was read that the table has, and the first is above 0."""
    places, numbers = [4 * r + c for r, c in channels], list(channels.values())
    for start, stop in table.blocks(BLOCK * len(table.channels)):
        values = table.read_values(start, stop)
        f, u = (values[name][:, numbers].astype(float) for name in ("f", "u_f"))
        first = f[:, numbers.index(channels[0, 0])]
        use = np.flatnonzero((values["flag"][:, numbers] == Flag.VALID).all(axis=1) & (first > 0))
        elements, uncertainties = np.zeros((use.size, 16)), np.zeros((use.size, 16))
        elements[:, places], uncertainties[:, places] = f[use], u[use]
        if use.size:
            yield Matrices(use + start, elements, uncertainties)


class Regions(NamedTuple):
    """Squares of both polar angles and sectors of the azimuth difference, degrees."""

    band: int
    sector: int

    @property
    def count(self) -> int:
        """How many there are, on both sides of the sample."""
        return (180 // self.band) ** 2 * (360 // self.sector)

    def numbers(self, table: Table, cells: np.ndarray) -> np.ndarray:
        """Those of the regions of cells."""
        theta_i, phi_i, theta_o, phi_o = np.degrees(angles_of(table.layout, cells)).T
        side, turns = 180 // self.band, 360 // self.sector
        light, detector = (np.minimum((a / self.band + 1e-9).astype(int), side - 1) for a in (theta_i, theta_o))
        turn = (np.mod(phi_o - phi_i + 1e-9, 360) / self.sector).astype(int) % turns
        return (light * side + detector) * turns + turn

    def place(self, number: int) -> dict[str, float]:
        """The middle of a region, degrees."""
        square, turn = divmod(number, 360 // self.sector)
        light, detector = divmod(square, 180 // self.band)
        polar = {"theta_i": (light + 0.5) * self.band, "theta_o": (detector + 0.5) * self.band}
        return polar | {"phi_i": 0.0, "phi_o": (turn + 0.5) * self.sector}


@dataclasses.dataclass(frozen=True)
class RegionMeans:
    """Means of matrices over regions in units of their m00, with their noise.

    All are weighed by 1/m00, so that bright readings do not hide dim ones.
    """

    regions: Regions
    number: np.ndarray
    """(regions,): as of `Regions.numbers`, of those in which readings are."""
    count: np.ndarray
    mean: np.ndarray
    """(regions, 16)."""
    error: np.ndarray
    """(regions, 16): standard uncertainty of the mean."""
    noise: np.ndarray
    """(regions, 16): of a single reading, by how much neighbours differ; NaN where too few were read."""
    brightness: np.ndarray
    """(regions,): harmonic mean of m00, 1/sr."""
    stated: bool
    """Whether uncertainties are stored for all, from which `error` is."""

    @classmethod
    def of(cls, table: Table, channels: Mapping[tuple[int, int], int]) -> Self:
        """The regions of a table in which matrices were read, as small as half of the readings have enough beside."""
        *smaller, largest = SIZES
        for size in smaller:
            means = cls._of(Regions(*size), table, channels)
            if means.stated or means.count[means.count >= FEWEST].sum() >= means.count.sum() / 2:
                return means
        return cls._of(Regions(*largest), table, channels)

    @classmethod
    def _of(cls, regions: Regions, table: Table, channels: Mapping[tuple[int, int], int]) -> Self:
        sums = _Sums(regions.count)
        for cells, elements, u in matrices_in_blocks(table, channels):
            sums.add(regions.numbers(table, cells), elements, u)
        number = np.flatnonzero(sums.count)
        n, first = sums.count[number, None], sums.total[number, :1]
        with np.errstate(invalid="ignore", divide="ignore"):
            noise = np.sqrt(sums.squares[number] / sums.steps[number, None]) * n / first
        noise[sums.count[number] < FEWEST] = np.nan
        stated = bool(np.isfinite(sums.variance).all())
        error = np.sqrt(sums.variance[number]) / first if stated else noise / np.sqrt(n)
        brightness = n[:, 0] / sums.inverse[number]
        return cls(regions, number, n[:, 0], sums.total[number] / first, error, noise, brightness, stated)


class _Sums:
    """Sums over the matrices of each region, block by block."""

    def __init__(self, size: int) -> None:
        self.size, self.floor = size, 0.0
        self.count, self.steps = (np.zeros(size, int) for _ in range(2))
        self.inverse = np.zeros(size)
        self.total, self.variance, self.squares = (np.zeros((size, 16)) for _ in range(3))

    def add(self, region: np.ndarray, elements: np.ndarray, u: np.ndarray) -> None:
        """More matrices (n, 16), of regions (n,)."""
        self.floor = self.floor or DARK * float(np.median(elements[:, 0]))
        weight = 1 / np.maximum(elements[:, :1], self.floor)
        self.count += np.bincount(region, minlength=self.size)
        self.inverse += np.bincount(region, weight[:, 0], self.size)
        self.total += _sums(region, weight * elements, self.size)
        self.variance += _sums(region, (weight * u) ** 2, self.size)
        order = np.argsort(region, kind="stable")
        ordered, weighed = region[order], (weight * elements)[order]
        same = np.diff(ordered) == 0
        self.steps += np.bincount(ordered[1:][same], minlength=self.size)
        # Of smooth readings neighbours differ by noise alone [von Neumann 1941].
        self.squares += _sums(ordered[1:][same], np.diff(weighed, axis=0)[same] ** 2 / 2, self.size)


def _sums(region: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    return np.stack([np.bincount(region, column, size) for column in values.T], axis=-1)
