"""The median of numbers: sorted; or of such as come in parts and are too many to be kept, exactly in little memory."""

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

BITS = 16
"""Of a number, by which it is counted in one pass."""
KEPT = 1 << 20
"""Numbers that are kept and sorted, at most."""
Parts = Callable[[], Iterable[np.ndarray]]
"""Gives all numbers in turn, each time that it is called."""


def sorted_median(numbers: np.ndarray) -> float:
    """`np.median` of at least one number, faster: processors sort vectors sooner than NumPy finds the middle."""
    ordered, middle = np.sort(numbers, axis=None), numbers.size // 2
    if np.isnan(ordered[-1]):
        return float("nan")
    return float(ordered[middle] if numbers.size % 2 else (ordered[middle - 1] + ordered[middle]) / 2.0)


def median_of_parts(parts: Parts) -> float:
    """The median of numbers that are 0 or more, as `np.median` has it; NaN of none."""
    counts = _counts(parts, 0, 64 - BITS)
    total = int(counts.sum())
    if not total:
        return float("nan")
    return float(np.mean(_of_ranks(parts, ((total - 1) // 2, total // 2), counts, 0, 64 - BITS)))


def _of_ranks(parts: Parts, ranks: Sequence[int], counts: np.ndarray, prefix: int, shift: int) -> list[float]:
    """The numbers of these ranks among those of whose bits the first are `prefix`, and the next are counted.

    Numbers above 0 are in the order of their bits.
    """
    ends, values = np.cumsum(counts), list[float]()
    digits = np.searchsorted(ends, ranks, "right").tolist()
    for digit in dict.fromkeys(digits):
        before, longer = int(ends[digit] - counts[digit]), prefix << BITS | digit
        within = [r - before for r, d in zip(ranks, digits, strict=True) if d == digit]
        if shift == 0:
            values += np.full(len(within), longer, np.uint64).view(np.float64).tolist()
        elif counts[digit] <= KEPT:
            kept = np.concatenate(list(_beginning(parts, longer, shift))).view(np.float64)
            values += np.partition(kept, within)[within].tolist()
        else:
            values += _of_ranks(parts, within, _counts(parts, longer, shift - BITS), longer, shift - BITS)
    return values


def _counts(parts: Parts, prefix: int, shift: int) -> np.ndarray:
    """How many numbers that begin with these bits have which as their next ones."""
    counts = np.zeros(1 << BITS, np.int64)
    for bits in _beginning(parts, prefix, shift + BITS):
        counts += np.bincount(((bits >> shift) & ((1 << BITS) - 1)).astype(np.int64), minlength=counts.size)
    return counts


def _beginning(parts: Parts, prefix: int, shift: int) -> Iterator[np.ndarray]:
    """The bits of those numbers that are `prefix` without the last `shift` of them."""
    for part in parts():
        bits = np.ascontiguousarray(part, np.float64).ravel().view(np.uint64)
        yield bits if shift == 64 else bits[bits >> shift == prefix]
