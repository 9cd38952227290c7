"""Medians and other quantiles of many numbers, of which some may be missing."""

import numpy as np


def quantiles(values: np.ndarray, *shares: float) -> list[float]:
    """The values below which so much of `values` lies, whatever their shape, but for NaN; NaN where all are.

    Between two values by linear interpolation. In memory for one more array of them.
    """
    unknown = np.isnan(values)
    known = values[~unknown] if unknown.any() else values.flatten()
    if not known.size:
        return [np.nan] * len(shares)
    places = [share * (known.size - 1) for share in shares]
    ends = [(min(int(x), known.size - 1), min(int(x) + 1, known.size - 1)) for x in places]
    known.partition(sorted({k for pair in ends for k in pair}))
    result = []
    for x, (low, high) in zip(places, ends, strict=True):
        below, above = float(known[low]), float(known[high])
        result.append(below if below == above else below + (x - low) * (above - below))
    return result


def median(values: np.ndarray) -> float:
    """`quantiles` of one half."""
    return quantiles(values, 0.5)[0]
