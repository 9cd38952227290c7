"""What a model leaves of readings, in the measure of a loss; and the same readings weighed anew."""

import equinox as eqx
import numpy as np

from gonio.fitting.problem.losses import transform, uses_cosine
from gonio.fitting.problem.readings import Readings, in_blocks
from gonio.fitting.solver.levenberg_marquardt import Problem


def compared(readings: Readings, loss: str, floor: float | np.ndarray, f: np.ndarray) -> np.ndarray:
    """T(f c) of a loss at the readings' directions, for values f of shape (n, C)."""
    c = np.asarray(readings.wi.z)[:, None] if uses_cosine(loss) else 1.0
    return transform(loss, f * c, floor, np)[0]


def weighted_residuals(
    readings: Readings, loss: str, floor: float | np.ndarray, weight: np.ndarray, f: np.ndarray
) -> np.ndarray:
    """w (T(f c) − T(y c)), (n, C), for the model's values f; 0 where there is no reading."""
    difference = compared(readings, loss, floor, f) - compared(readings, loss, floor, readings.f)
    return np.where(weight > 0, weight * difference, 0.0)


def laid(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Values (n, C) in the blocks of a problem, padded with 0: (B, block, C)."""
    return in_blocks(values, problem.data.weight.shape)


def reweighed(problem: Problem, weight: np.ndarray) -> Problem:
    """The same problem with other weights (n, C); no array changes its shape, and nothing compiles again."""
    held = laid(problem, weight)
    target_norm_squared = np.asarray(np.sum((held * problem.data.target) ** 2))
    return eqx.tree_at(lambda q: (q.data.weight, q.target_norm_squared), problem, (held, target_norm_squared))


def retargeted(problem: Problem, target: np.ndarray) -> Problem:
    """The same problem with other targets T(y c), (n, C)."""
    held = laid(problem, target)
    target_norm_squared = np.asarray(np.sum((held * problem.data.weight) ** 2))
    return eqx.tree_at(lambda q: (q.data.target, q.target_norm_squared), problem, (held, target_norm_squared))
