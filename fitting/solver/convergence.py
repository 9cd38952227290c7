"""When a fit has converged: as near to stationary as the caller's precision allows, which need not be double."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.domains import Domains, at_bounds
from gonio.fitting.problem.normal_equations import NormalEquations

STATIONARY = 1e-6  # largest projected gradient of a stationary fit, in double precision
SINGLE = 16.0  # roundings of what is compared, from which on a gradient in single precision says nothing
EXACT = 1e3  # of the rounding of the data: residuals up to there are none


class Stationarity(NamedTuple):
    """How stationary p (..., P) is. Parameters on an active bound or without sensitivity do not count in the first.

    `projected_gradient`: max_j |J_jᵀr|/(‖J_j‖‖r‖); `active_bound` (..., P): on a bound that the cost pushes against;
    `zero_sensitivity` (..., P): without any effect on the residuals.
    """

    projected_gradient: np.ndarray
    active_bound: np.ndarray
    zero_sensitivity: np.ndarray


def stationarity(d: Domains, p: np.ndarray, equations: NormalEquations) -> Stationarity:
    """The projected gradient at p, any leading axes."""
    low, high = at_bounds(d, p)
    active = (low & (equations.gradient >= 0)) | (high & (equations.gradient <= 0))
    length2 = np.diagonal(equations.matrix, axis1=-2, axis2=-1)
    silent = length2 <= 0
    norm = np.sqrt(2.0 * np.maximum(np.asarray(equations.cost)[..., None], 1e-300))
    scale = np.sqrt(np.where(silent, 1.0, length2)) * norm
    share = np.where(active | silent, 0.0, np.abs(equations.gradient) / scale)
    return Stationarity(np.max(share, axis=-1, initial=0.0), active, silent)


def eps() -> float:
    """Relative spacing of the numbers that programs are compiled for."""
    return float(np.finfo(jnp.result_type(float)).eps)


def is_double() -> bool:
    """Whether programs are compiled for double precision."""
    return eps() < 1e-12


def stationary_limit(cost: float, target_norm_squared: float) -> float:
    """Largest projected gradient of a stationary fit of this cost, ½‖r‖².

    1e-6; in single precision no less than what the rounding of model and data makes of it, and no more than 1e-3.
    """
    if is_double():
        return STATIONARY
    compared = 1.0 + np.sqrt(target_norm_squared / max(2.0 * cost, 1e-300))
    return float(np.clip(SINGLE * eps() * compared, STATIONARY, 1e-3))


def is_exact(cost: float, target_norm_squared: float) -> bool:
    """‖r‖ ≤ 10³ eps ‖data‖: the residual is rounding."""
    return 2.0 * cost <= (EXACT * eps()) ** 2 * target_norm_squared
