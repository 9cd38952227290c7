"""Ranges of cells in C order as rectangular pieces of an array."""

import math
from collections.abc import Iterator


def boxes(shape: tuple[int, ...], start: int, stop: int) -> Iterator[tuple[slice, ...]]:
    """The rectangular pieces, in order, that make up the C-order range start..stop of such an array."""
    if len(shape) == 1:
        yield (slice(start, stop),)
        return
    inner = math.prod(shape[1:])
    (row, head), (last, tail) = divmod(start, inner), divmod(stop, inner)
    if row == last:
        yield from ((slice(row, row + 1), *box) for box in boxes(shape[1:], head, tail))
        return
    if head:
        yield from ((slice(row, row + 1), *box) for box in boxes(shape[1:], head, inner))
        row += 1
    if row < last:
        yield (slice(row, last), *(slice(0, n) for n in shape[1:]))
    if tail:
        yield from ((slice(last, last + 1), *box) for box in boxes(shape[1:], 0, tail))
