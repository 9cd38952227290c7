"""Noise of pairs of readings whose uncertainties are not stated, from what the pairs themselves differ by.

It is the median of their deviations in the smallest region, which a violation of up to half of its pairs does not
change, and no less than that of pairs of like brightness: dark readings may have noise that does not become smaller
with them.
"""

import numpy as np

from gonio.checks.table.statistics.quantiles import median

Regions = list[tuple[str, int, np.ndarray]]
"""(size, number, indices) of the regions of pairs."""

BRIGHT = 48
"""Pairs of like brightness from which their noise is taken."""

MAD = 1.4826
"""Standard deviations in a median absolute deviation of a normal law."""

NOTHING = 1e-290
"""The mean of two readings that are both zero, and the least of others."""

MOST = 1.0
"""Noise relative to the mean of a pair, of two readings that know nothing of each other."""


def noise_of_pairs(d: np.ndarray, size: np.ndarray, regions: Regions) -> np.ndarray:
    """The standard deviation of the noise of each relative difference, (n,).

    Args:
        d: differences relative to the means of the pairs, (n,), positive where a violation makes them so.
        size: these means, (n,).
        regions: the regions of the pairs, the smallest first.
    """
    lit = np.flatnonzero(size > NOTHING)  # two readings that were cut off at zero say nothing of the noise
    groups = [lit[some] for some in _by_brightness(size[lit])]
    by_brightness = _noise_by_brightness(d, groups)
    noise = np.maximum(_local_noise(d, regions), np.minimum(by_brightness, _band_noise(d, regions)))
    return np.maximum(noise, _noise_of_dark(d, size, groups))


def _deviation(d: np.ndarray) -> float:
    return MAD * median(np.abs(d - median(d)))


def _local_noise(d: np.ndarray, regions: Regions) -> np.ndarray:
    # Of the smallest region that holds enough pairs: a violation that ends elsewhere is not taken for noise.
    noise = np.zeros(d.size)
    for _, _, group in reversed(regions):
        noise[group] = _deviation(d[group])
    return noise


def _band_noise(d: np.ndarray, regions: Regions) -> np.ndarray:
    noise = np.full(d.size, _deviation(d))
    for size, _, group in regions:
        if size == "band":
            noise[group] = _deviation(d[group])
    return noise


def _by_brightness(size: np.ndarray) -> list[np.ndarray]:
    """Numbers of the pairs in equal groups from dark to bright, (groups, count); the first have one pair more."""
    order, groups = np.argsort(size, kind="stable"), max(1, size.size // BRIGHT)
    few, more = divmod(size.size, groups)
    split = more * (few + 1)
    parts = order[:split].reshape(more, few + 1), order[split:].reshape(groups - more, few)
    return [some for some in parts if some.size]


def _noise_by_brightness(d: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    noise = np.zeros(d.size)
    for some in groups:
        off = np.abs(d[some] - np.median(d[some], axis=1, keepdims=True))
        noise[some] = MAD * np.median(off, axis=1, keepdims=True)
    return noise


def _noise_of_dark(d: np.ndarray, size: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    """That of readings whose noise does not become smaller with them.

    Noise has both signs and a violation has one: that of the quieter side is noise. The noise of a detector, of
    photons or of speckle, relative to the readings, is nowhere larger than where it is darker.
    """
    noise, least = np.zeros(d.size), np.inf
    for some in groups:
        quieter = np.minimum.accumulate(np.minimum(_quieter_side(d[some]), least), axis=0)
        least = float(quieter[-1, 0])
        middle = np.median(size[some], axis=1, keepdims=True)
        noise[some] = np.minimum(quieter * np.maximum(middle / size[some], 1), MOST)
    return noise


def _quieter_side(d: np.ndarray) -> np.ndarray:
    """The smaller of the deviations of the differences that are not negative and of those not positive, (groups, 1)."""
    ordered, last = np.sort(d, axis=1), d.shape[1] - 1
    below, above = (np.count_nonzero(side, axis=1)[:, None] for side in (ordered <= 0, ordered >= 0))
    sides = []
    for count, first in ((below, 0), (above, last + 1 - above)):
        middle = [np.clip(first + k, 0, last) for k in ((count - 1) // 2, count // 2)]
        value = np.mean([np.abs(np.take_along_axis(ordered, k, axis=1)) for k in middle], axis=0)
        sides.append(np.where(count > 0, MAD * value, 0.0))
    return np.minimum(*sides)
