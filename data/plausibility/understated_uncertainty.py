"""How far readings scatter beyond the uncertainties that they store, as far as neighbours show it.

Each reading is off a cubic through its four neighbours by noise and by what f bends. Noise makes two such differences
that follow each other opposite (their correlation on even steps is -0.8), a bend makes them alike: the median of their
negative products measures the noise, and a bend can only make it smaller.
"""

import dataclasses
import functools
import math

import numpy as np

from gonio.data.flags import Flag
from gonio.data.plausibility.neighbours import cubic_weights, windows
from gonio.data.table import Table

WINDOWS = 1000
"""Of six readings along an axis, of each axis; of more, a random choice."""
FEWEST = 60
"""Windows below which their scatter says nothing."""
SURE = 4.0
"""Standard errors by which the scatter must be above what is stored."""
LONG_AXIS = 12
"""Nodes of an axis of which most windows are away from a lobe."""
QUANTILES = 400
ROUND = 1 / 64
"""Steps of correlations whose quantiles are kept."""
DIFFERENCES = np.array([[0, 1, 2, 3, 4], [1, 2, 3, 4, 5]])


def understated_uncertainty(table: Table) -> np.ndarray:
    """Factor (channels,) by which readings scatter more than u_f says, 1 where nothing shows that.

    The brighter and the darker half of the readings are looked at by themselves; the larger factor counts. A lobe
    narrower than the steps of an axis looks like noise along it: the axis that shows the least counts.
    """
    if table.u_f is None or table.interpolant is not None:
        return np.ones(len(table.channels))
    of_axes = []
    for cells, places in windows(table, 6, WINDOWS, LONG_AXIS):
        apart = (np.diff(places, axis=1) > 0).all(axis=1)
        if np.count_nonzero(apart) >= FEWEST:
            of_axes.append(_factors(table, cells[apart], places[apart]))
    least = np.min([np.full((2, len(table.channels)), np.inf), *of_axes], axis=0)
    return np.where(np.isfinite(least), least, 1.0).max(axis=0)


def as_scattered(table: Table, factor: np.ndarray) -> Table:
    """The table with uncertainties as large as its readings scatter."""
    if table.u_f is None or not (factor > 1).any():
        return table
    return dataclasses.replace(table, u_f=np.asarray(table.u_f[...], float) * factor)


def _factors(table: Table, cells: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Factors (2, channels) of the brighter and the darker half by these windows, infinite of too few."""
    block = table.values_at(cells.ravel())
    f, u, flag = (np.asarray(block[name]).reshape(*cells.shape, -1) for name in ("f", "u_f", "flag"))
    use = ((flag == Flag.VALID) & (u > 0) & np.isfinite(u)).all(axis=1)
    f, variance = np.where(use[:, None], f, 0.0).astype(float), np.where(use[:, None], u, 1.0).astype(float) ** 2
    weight = np.zeros((2, *cells.shape))
    for number, part in enumerate(DIFFERENCES):
        weight[number][:, part] = cubic_weights(places[:, part])
    off = np.einsum("dkj,kjc->dkc", weight, f)
    spread = np.sqrt(np.einsum("dkj,kjc->dkc", weight**2, variance))
    ratio = -off[0] * off[1] / (spread[0] * spread[1])
    correlation = np.einsum("kj,kjc->kc", weight[0] * weight[1], variance) / (spread[0] * spread[1])
    result = np.full((2, f.shape[-1]), np.inf)
    for c in range(f.shape[-1]):
        bright = f[:, 2, c] >= np.median(f[use[:, c], 2, c]) if use[:, c].any() else use[:, c]
        for number, half in enumerate((use[:, c] & bright, use[:, c] & ~bright)):
            if np.count_nonzero(half) >= FEWEST / 2:
                result[number, c] = _factor(
                    ratio[half, c], float(np.median(correlation[half, c])), not table.layout.gridded
                )
    return result


def _factor(ratio: np.ndarray, correlation: float, one_axis: bool) -> float:
    """By how much the scatter of standardised differences exceeds theirs; 1 where that is not sure.

    `one_axis`: no other axis tells a narrow lobe from noise, and a third of the windows may be on one.
    """
    excess = float(np.median(ratio))
    # The quantiles fall with the correlation: those of a round one above it show most tables to be right.
    bound = _quartiles(min(math.ceil(correlation / ROUND) * ROUND, 1.0))
    if excess <= bound[2 if one_axis else 1]:
        return 1.0
    quarter, expected, upper = _quartiles(correlation)
    error = 0.9 * (upper - quarter) / math.sqrt(ratio.size)
    least = upper if one_axis else expected
    return math.sqrt(excess / expected) if excess > least + SURE * error else 1.0


@functools.lru_cache(maxsize=64)
def _quartiles(correlation: float) -> tuple[float, float, float]:
    """Of −xy, of two normal numbers x and y of this correlation."""
    p = (np.arange(QUANTILES) + 0.5) / QUANTILES
    normal = np.sort(np.random.default_rng(0).standard_normal(QUANTILES * 50))[(p * QUANTILES * 50).astype(int)]
    # xy of two normal numbers is a difference of two independent squares.
    stated = ((1 - correlation) * normal[:, None] ** 2 - (1 + correlation) * normal**2).ravel() / 2
    quarter, expected, upper = np.quantile(stated, (0.25, 0.5, 0.75)).tolist()
    return quarter, expected, upper
