"""Weights of a profile's readings that state no uncertainty: a share of the reading, and a constant beside it."""

import numpy as np

CONSTANTS = 65
"""That are tried, from a tenth of the smallest value to the largest one."""
SMALLEST = 1e-40
"""Of them, over the largest value: its square is a number."""
MIN_FREEDOM = 4
"""Readings more than numbers, below which they do not tell a constant from a share."""
MOST_LEVERAGE = 0.9


def relative_weights(y: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Weights (n,) of a noise that is a share of each reading y (n,), 0 where there is none.

    Negative readings show how far noise reaches about zero: nothing is surer than that.
    """
    size = np.abs(y[valid & (y != 0)])
    floor = max(float(np.max(-y[valid], initial=0.0)), float(np.min(size, initial=np.inf)))
    return np.where(valid, 1 / np.maximum(np.abs(y), floor), 0.0)


def even_weights(y: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Weights (n,) of a noise that is the same everywhere, over the largest reading."""
    return np.where(valid, 1 / np.max(np.abs(y[valid])), 0.0)


def likeliest_weights(model: np.ndarray, residual: np.ndarray, leverage: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Weights (n,) of the noise a²(m² + b²) that makes the residuals of a fit likeliest, over a.

    The variance function is that of Carroll & Ruppert 1988, chapter 3; the values m of the model stand in for the
    readings, which are small by chance where they would count most.

    Args:
        model: values of the fitted model (n,).
        residual: readings less these (n,).
        leverage: diagonal of the fit's hat matrix (n,), by which residuals are too small.
        valid: which readings there are (n,).
    """
    m, r2 = np.abs(model[valid]), residual[valid] ** 2 / np.maximum(1 - leverage[valid], 1 - MOST_LEVERAGE)
    most = max(float(m.max()), 1e-100)
    constants = np.geomspace(max(float(m.min()) / 10, SMALLEST * most), most, CONSTANTS)
    variance = m**2 + constants[:, None] ** 2
    unlikeliness = m.size * np.log(np.maximum(np.mean(r2 / variance, axis=1), 1e-300)) + np.log(variance).sum(axis=1)
    constant = constants[np.argmin(unlikeliness)]
    return np.where(valid, 1 / np.hypot(model, constant), 0.0)
