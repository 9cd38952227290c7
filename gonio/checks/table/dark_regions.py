"""What readings that should be equal may differ by where they are too dark to be tested, as a share of the light.

No number of readings decides on a few per cent of nothing. A region that is open at the tolerance is bounded in 1/sr in
place of per cent of itself: together such regions may change what the sample scatters at an incidence by no more than
the same tolerance, or, at an incidence that is dark itself, by no more than the tolerance of the brightest one.
"""

import dataclasses

import numpy as np

from gonio.checks.table.pairs.places import BAND, SECTOR, SIDE
from gonio.checks.table.statistics.region_sums import Region

PROJECTED = np.pi * np.abs(np.diff(np.sin(np.radians(BAND) * np.arange(SIDE + 1)) ** 2))
"""Projected solid angle of each band of polar angles, over all azimuths, sr."""
SECTORS = round(180 / SECTOR)
"""Sectors of azimuth difference, each of which lies on both sides of the plane of incidence."""


@dataclasses.dataclass(frozen=True)
class OpenLight:
    """By bands of incidence, (SIDE,): what is scattered of the light, at most all of it, and what may change of it."""

    light: np.ndarray
    change: np.ndarray

    def worst(self, tolerance: float) -> tuple[float, float]:
        """(the change over what may change, the change over the light) at the worst incidence; below 1 it may.

        An incidence at which all that is scattered, and may be, is below the tolerance of the brightest, is dark.
        """
        brightest = tolerance * float(self.light.max())
        allowed = np.maximum(tolerance * self.light, brightest - self.light)
        share = self.change / np.maximum(allowed, 1e-300)
        k = int(np.argmax(share))
        of = self.light[k] if tolerance * self.light[k] >= brightest - self.light[k] else self.light.max()
        return float(share[k]), float(self.change[k] / max(of, 1e-300))


def light_of_open_regions(regions: list[Region], is_open: np.ndarray, absolute: np.ndarray) -> OpenLight:
    """The light of one channel by bands of incidence, of its regions of all sizes.

    Args:
        regions: of all sizes; each open one counts, also where it holds a smaller one that is open.
        is_open: (n,), of the regions.
        absolute: (n,), what readings of each may differ by, 1/sr.
    """
    light, change = np.zeros(SIDE), np.zeros(SIDE)
    for region, opened, most in zip(regions, is_open, absolute, strict=True):
        if region.size == "square":
            _scatter(light, region, max(region.light, 0.0) / region.count)
        if opened:
            _scatter(change, region, float(most))
    return OpenLight(np.minimum(light, 1.0), change)


def _scatter(flux: np.ndarray, region: Region, f: float) -> None:
    """Adds what f all over a region scatters, by incidences in the band of either direction."""
    if region.size == "everywhere":
        flux += f * PROJECTED.sum()
        return
    square = region.number // 100 if region.size == "sector" else region.number
    high, low = divmod(square, SIDE) if region.size != "band" else (square, np.arange(square + 1))
    share = 1 / SECTORS if region.size == "sector" else 1.0
    others = np.atleast_1d(low)
    flux[high] += f * share * PROJECTED[others].sum()
    flux[others[others != high]] += f * share * PROJECTED[high]
