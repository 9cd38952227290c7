"""The error of a prediction over all directions, and what some readings show of it."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t

from gonio.instrument.instrument import Instrument
from gonio.models.geometry.directions import from_spherical
from gonio.planning.candidates import TILTS, Angles, highest, readable
from gonio.planning.ways import Way

FLOOR = 1e-3 / math.pi
"""1/sr, a thousandth of the perfect diffuser: below, differences count relative to this."""
UNSURE = 2.0
"""Standard uncertainties by which a reading must be above its prediction before it counts as larger."""
LEVEL = 0.95
MEASURE = (
    "rms of |f − prediction| / (the larger of both + 0.1 % of white) over directions of which half are cosine-weighted "
    "anywhere and half are about mirror reflection, or where light goes through, of facets that are tilted by angles "
    "even in their logarithm from 0.1° to 60°"
)


def random_directions(
    count: int, instrument: Instrument, isotropic: bool, rng: np.random.Generator, ways: Sequence[Way] = (Way(),)
) -> Angles:
    """About `count` directions (4, n) as `MEASURE` weighs them, that the instrument reads; by turns on each way."""
    high_i, high_o = (math.sin(a) ** 2 for a in highest(instrument))
    parts, size = [], 0
    while size < count:
        u = rng.random((5, 2 * count))
        light = np.stack([np.arcsin(np.sqrt(u[0] * high_i)), 2 * np.pi * u[1]])
        anywhere = np.stack([np.arcsin(np.sqrt(u[2] * high_o)), 2 * np.pi * u[3]])
        tilt = TILTS[0] * (TILTS[1] / TILTS[0]) ** u[2]
        facet, number = from_spherical(tilt, 2 * np.pi * u[3], np), np.arange(2 * count) % len(ways)
        about = np.zeros_like(anywhere)
        for k, way in enumerate(ways):
            about = np.where(number == k, way.sent(light, facet), about)
        every = np.concatenate([light, np.where(u[4] < 0.5, anywhere, about)])
        for k, way in enumerate(ways):
            every[:, number == k] = np.where(every[2] < np.pi / 2, way.unfolded(every), np.nan)[:, number == k]
        parts.append(readable(every[:, np.isfinite(every[2])], instrument, isotropic))
        size += parts[-1].shape[1]
        if not size:
            break
    return np.concatenate(parts, axis=1)[:, :count]


def difference(predicted: np.ndarray, f: np.ndarray, u_f: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(relative differences, their standard uncertainties) of predictions from readings, arrays, as in `MEASURE`."""
    size = np.maximum(np.abs(predicted), np.abs(f) - UNSURE * u_f) + FLOOR
    return np.abs(f - predicted) / size, u_f / size


def readings_needed(counts: np.ndarray, errors: np.ndarray, goal: float) -> float:
    """Readings at which an error falls to `goal`, if it falls on as in the last two halvings of their number.

    The power of the number by which it falls is that between the medians of both; infinite where it does not fall, and
    0 where it is there.

    Args:
        counts: readings so far at each error (n,), in ascending order.
        errors: relative ones (n,).
        goal: a relative error.
    """
    last = counts > counts[-1] / 2
    before = ~last & (counts > counts[-1] / 4)
    if errors[-1] <= goal or not before.any():
        return 0.0
    middles = [(np.median(np.log(counts[half])), np.median(np.log(errors[half]))) for half in (before, last)]
    (n_before, e_before), (n_last, e_last) = middles
    power = (e_before - e_last) / (n_last - n_before)
    if power <= 0:
        return math.inf
    return math.exp(min(n_last + max(e_last - math.log(goal), 0.0) / power, 700.0))


class Error(NamedTuple):
    """An rms error, and the bound that it is below with a stated probability; from so many readings."""

    value: float
    bound: float
    readings: int


def shown(squares: np.ndarray, level: float = LEVEL) -> Error:
    """The root of the mean that independent samples (n,) of an error's square show.

    The bound is Student's, corrected for skewness [Chen 1995], of these samples and one twice as large as the largest:
    rare large errors are the ones that few samples miss.
    """
    if squares.size < 2:
        return Error(1.0, 1.0, squares.size)
    x = np.append(squares, 2 * max(squares.max(), 0.0))
    spread, quantile = x.std(ddof=1), t.ppf(level, x.size - 1)
    skew = np.mean((x - x.mean()) ** 3) / max(spread, 1e-300) ** 3 / (6 * math.sqrt(x.size))
    wide = quantile + skew * (1 + 2 * quantile**2) + 4 * skew**2 * (quantile + 2 * quantile**3)
    most = x.mean() + wide * spread / math.sqrt(x.size)
    value, bound = (math.sqrt(min(max(float(square), 0.0), 1.0)) for square in (squares.mean(), most))
    return Error(value, bound, squares.size)
