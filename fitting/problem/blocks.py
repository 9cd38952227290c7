"""Samples of a fit as programs take them: in blocks that a cache holds, and pages of so many blocks."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from gonio.models.geometry.directions import Direction

PAGE = 16  # blocks of a page
LANES = 16


def block_of(channels: int) -> int:
    """Samples of a block: what a core's cache holds of their residuals and derivatives."""
    return max(64, 512 >> max(0, (channels - 1).bit_length() - 2))


class Samples(NamedTuple):
    """Samples of a fit in blocks, padded with weight 0. B blocks, a multiple of `PAGE`, of n samples, C channels."""

    wi: Direction  # components (B, n)
    wo: Direction
    target: Float[Array, "B n C"]  # T(y c)
    weight: Float[Array, "B n C"]
    blocks: Array  # how many of the B are in use
    floor: Array  # of the loss


def pages(data: Samples | list[Samples]) -> list[Samples]:
    """The pages in use, each as `Samples` of `PAGE` blocks, without copies; those already made as they are."""
    if isinstance(data, list):
        return data
    whole = jax.tree.map(np.asarray, data)
    used, found = int(whole.blocks), []
    for first in range(0, used, PAGE):
        cut = slice(first, first + PAGE)
        wi, wo = (Direction(*(c[cut] for c in w)) for w in (whole.wi, whole.wo))
        blocks = np.asarray(min(PAGE, used - first))
        found.append(Samples(wi, wo, whole.target[cut], whole.weight[cut], blocks, whole.floor))
    return found
