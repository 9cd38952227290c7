"""Tests of sums of standardised differences, one for each region, where a reading may be a count of photons."""

from typing import NamedTuple

import numpy as np

from gonio.checks.table.statistics.counts import FARTHEST, normal_p
from gonio.checks.table.statistics.cumulants import Generating, standard_counts, tilts
from gonio.models.special.scipy_functions import ndtr

COARSE = 0.1
"""Standard deviations of a sum that one count makes, above which its tail has steps."""


class Counted(NamedTuple):
    """Readings (n,), 1/sr: their values, standard uncertainties, and what one count adds to each."""

    f: np.ndarray
    u: np.ndarray
    count: np.ndarray


def sums_p(z: np.ndarray, sizes: np.ndarray, up: Counted, down: Counted) -> np.ndarray:
    """Two-sided p-values (R,) of sums of standardised differences of readings that are expected to be the same.

    Where a single count makes much of a sum it is Chernoff's bound, elsewhere the normal tail or the saddlepoint's.

    Args:
        z: each sum, over the root of its number of differences, (R,).
        sizes: how many differences each sum has, at least 1, (R,): the first sum has the first ones.
        up, down: the reading that counts upwards in each difference, and the other one.

    References:
        Lugannani & Rice 1980, Adv. Appl. Probab. 12, 475, for the saddlepoint's tail; Chernoff 1952, Ann. Math. Stat.
        23, 493, for the bound.
    """
    (a, u_a, q_a), (b, u_b, q_b) = up, down
    mean = np.maximum((a * u_b**2 + b * u_a**2) / (u_a**2 + u_b**2), 0.0)
    of_up = _tails(np.abs(z), sizes, standard_counts(u_a, u_b, q_a, q_b, mean))
    of_down = _tails(np.abs(z), sizes, standard_counts(u_b, u_a, q_b, q_a, mean))
    return np.clip(of_up + of_down, normal_p(z), 1.0)


def _tails(
    z: np.ndarray, sizes: np.ndarray, counts: tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]
) -> np.ndarray:
    """One-sided tails (R,) beyond z of sums of counts."""
    number = np.repeat(sizes, sizes)
    whole = Generating(sizes, np.stack(counts[0]) / number, np.stack(counts[1]) / np.sqrt(number))
    coarse = whole.largest() > COARSE
    x = np.where(coarse, z, np.minimum(z, FARTHEST))
    t = tilts(whole, x)
    w2 = np.maximum(2 * (t * x - whole.value(t)), 1e-12)
    w, u = np.sqrt(w2), t * np.sqrt(whole.tilted(t)[1])
    with np.errstate(invalid="ignore", divide="ignore"):  # of the coarse ones
        fine = ndtr(-w) + np.exp(-w2 / 2) / np.sqrt(2 * np.pi) * (1 / u - 1 / w)
    return np.where(coarse, np.exp(-w2 / 2), fine)
