"""Medians and other quantiles of many numbers, of which some may be missing; and their order."""

import numpy as np


def quantiles(values: np.ndarray, *shares: float) -> list[float]:
    """The values below which so much of `values` lies, whatever their shape, but for NaN; NaN where all are.

    Between two values by linear interpolation. In memory for one more array of them.
    """
    unknown = np.isnan(values)
    known = values[~unknown] if unknown.any() else values.flatten()
    if not known.size:
        return [np.nan] * len(shares)
    result = []
    for share in shares:
        place = share * (known.size - 1)
        low = min(int(place), known.size - 1)
        known.partition(low)  # for one place alone NumPy has a fast way
        below = float(known[low])
        above = float(known[low + 1 :].min()) if low + 1 < known.size and place > low else below
        result.append(below if below == above else below + (place - low) * (above - below))
    return result


def median(values: np.ndarray) -> float:
    """`quantiles` of one half."""
    return quantiles(values, 0.5)[0]


def stable_order(values: np.ndarray) -> np.ndarray:
    """`np.argsort(values, kind="stable")` of numbers, (n,), in less than half of its time."""
    order = np.argsort(values)
    ordered = values[order]
    new = ordered[1:] != ordered[:-1]
    if new.all():
        return order
    run = np.zeros(values.size, np.int64)
    np.cumsum(new, out=run[1:])
    key = run * values.size + order
    key.sort()
    return key % values.size
