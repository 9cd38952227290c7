"""Samples of a fit as programs take them: in blocks that a cache holds, and pages of so many blocks."""

import math
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from gonio.models.geometry.directions import Direction

PAGE = 16  # blocks of a page
LANES = 16  # vectors of free numbers that a program takes side by side
AnyArray = jax.Array | np.ndarray
ALIGNED = 64  # bytes: what XLA asks of memory that it may use without a copy


def block_of(channels: int) -> int:
    """Samples of a block: what a core's cache holds of their residuals and derivatives."""
    return max(64, 512 >> max(0, (channels - 1).bit_length() - 2))


class Samples(NamedTuple):
    """Samples of a fit in blocks, padded with weight 0. B blocks, a multiple of `PAGE`, of n samples, C channels."""

    wi: Direction  # components (B, n)
    wo: Direction
    target: Float[AnyArray, "B n C"]  # T(y c)
    weight: Float[AnyArray, "B n C"]
    blocks: AnyArray  # how many of the B are in use
    floor: AnyArray  # of the loss


def pages(whole: Samples) -> list[Samples]:
    """The pages in use, each as `Samples` of `PAGE` blocks, without copies."""
    used, parts = int(whole.blocks), []
    for first in range(0, used, PAGE):
        cut = slice(first, first + PAGE)
        wi, wo = (Direction(*(c[cut] for c in w)) for w in (whole.wi, whole.wo))
        blocks = np.asarray(min(PAGE, used - first))
        parts.append(Samples(wi, wo, whole.target[cut], whole.weight[cut], blocks, whole.floor))
    return parts


def block_shape(n: int, channels: int) -> tuple[int, int]:
    """(blocks, a multiple of those of a page, samples of a block) that hold n samples."""
    block = block_of(channels)
    return max(1, -(-n // (block * PAGE))) * PAGE, block


def in_blocks(a: np.ndarray, shape: tuple[int, ...], fill: float = 0.0) -> np.ndarray:
    """Values (n, ...) laid out in blocks (B, block, ...), padded with `fill`, where XLA reads them without a copy.

    Directions that are laid out already (by `readings_of`) are taken as they stand.
    """
    number = math.prod(shape)
    base = a.base
    if a.ndim == 1 and isinstance(base, np.ndarray) and base.size == number * 8 + ALIGNED and base.dtype == np.uint8:
        start = -base.ctypes.data % ALIGNED
        if a.ctypes.data == base.ctypes.data + start and a.dtype == np.float64:
            return base[start : start + 8 * number].view(np.float64).reshape(shape)
    raw = np.empty(8 * number + ALIGNED, np.uint8)
    start = -raw.ctypes.data % ALIGNED
    whole = raw[start : start + 8 * number].view(np.float64).reshape(shape)
    flat = whole.reshape(-1, *shape[2:])
    flat[: a.shape[0]] = a
    flat[a.shape[0] :] = fill
    return whole
