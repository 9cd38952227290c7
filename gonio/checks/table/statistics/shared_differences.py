"""What of the differences of pairs, whose signs are not known, neighbouring pairs share.

The noise of a pair is independent of the next one's; a surface, or an instrument, differs there alike. So the mean
product of neighbouring differences is the square of what is no noise.
"""

import numpy as np

from gonio.checks.table.statistics.counts import critical

MOST_PAIRS = 50_000
"""Of more pairs as many are taken, beside each other."""

FEWEST_PAIRS = 8
"""Independent products below which nothing is known."""


def least_shared(d: np.ndarray, angles: np.ndarray, level: float) -> float:
    """The least root mean square difference that is no noise, at a level: 0 where all of it may be.

    Products of a pair and its nearest one are correlated by r; the least r is that of Fisher's transformation.

    Args:
        d: relative differences, (n,), those of neighbouring pairs taken in the same order.
        angles: theta_i, phi_i, theta_o, phi_o of the pairs, (n, 4), radians.
        level: probability that noise alone shows more.

    References:
        R. A. Fisher (1921), Metron 1, 3-32.
    """
    d, angles = d[:MOST_PAIRS], angles[:MOST_PAIRS]
    products = d.size / 2  # each of two that are nearest to each other counts twice
    square = float(np.mean(d**2))
    if products < FEWEST_PAIRS or not square:
        return 0.0
    from scipy.spatial import KDTree

    theta_i, phi_i, theta_o, phi_o = angles.T
    # By the azimuths themselves: at the normal, where they are no direction, the pair of the same azimuths is near.
    places = np.stack([theta_i, np.cos(phi_i), np.sin(phi_i), theta_o, np.cos(phi_o), np.sin(phi_o)], axis=1)
    near = np.asarray(KDTree(places).query(places, 2)[1])
    other = np.where(near[:, 0] == np.arange(d.size), near[:, 1], near[:, 0])
    correlation = 2 * float(np.sum(d * d[other])) / float(np.sum(d**2) + np.sum(d[other] ** 2))
    z = np.arctanh(np.clip(correlation, -0.999999, 0.999999)) - critical(level) / np.sqrt(products - 3)
    return float(np.sqrt(square * max(np.tanh(z), 0.0)))
