"""Readings of fewer than one expected count: what a photon counter says in the dark."""

import numpy as np

COUNTS = (0.7, 4.5)
"""What so few counts come to, over the count that the stated uncertainty and the model make."""


def of_rare_counts(f: np.ndarray, model: np.ndarray, weight: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Which readings (n, C) are none, or a few counts where less than one is expected.

    Where the signal's own counts λ are all noise there is, u = q √λ of f = q λ: the model over u is √λ. Far below one
    count nearly all readings are 0 and lie below the model, and the rest lie far above it: the signs and sizes of such
    residuals are those of no symmetric noise, whose order could be tested. Other noise has no exact zeros beside its
    negative readings.

    Args:
        f: readings.
        model: what is expected.
        weight: one over the stated uncertainties.
        used: which readings count.
    """
    share = model * weight
    dark = used & (share < 1.0) & (share > 0.0)
    counting = (dark & (f == 0)).any(axis=0) & ~(dark & (f < 0)).any(axis=0)
    counts = share * weight * f
    return dark & counting & ((f == 0) | ((counts > COUNTS[0]) & (counts < COUNTS[1])))
