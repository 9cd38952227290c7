"""Points that fill the unit cube evenly in any number."""

import numpy as np


def low_discrepancy(count: int, dimensions: int, seed: float = 0.5, skip: int = 0) -> np.ndarray:
    """(count, dimensions): points of the unit cube by the additive recurrence with the generalised golden ratio
    [Roberts 2018].

    Args:
        count: number of points.
        dimensions: of the cube.
        seed: coordinate at which the sequence starts in every dimension, in [0, 1).
        skip: number of points left out at the beginning of the sequence.
    """
    ratio = 2.0
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return (seed + np.arange(skip + 1, skip + count + 1)[:, None] * steps) % 1.0
