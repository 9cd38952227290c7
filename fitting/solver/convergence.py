"""What a fit can ask of its arithmetic: as much as the caller's precision allows, which need not be double."""

import jax
import numpy as np

DOUBLE, FLOAT = float(np.finfo(np.float64).eps), float(np.finfo(np.float32).eps)
STATIONARY = 1e-6  # DESIGN's limit, in double precision
SINGLE = 16.0  # roundings of what is compared, from which on a gradient in single precision says nothing
EXACT = 1e3  # of the rounding of the data: residuals up to there are none


def eps() -> float:
    """Relative spacing of the numbers that programs are compiled for."""
    return DOUBLE if jax.config.jax_enable_x64 else FLOAT


def is_double() -> bool:
    """Whether programs are compiled for double precision."""
    return eps() < 1e-12


def stationary_limit(cost: float, target_norm_squared: float) -> float:
    """Largest projected gradient of a stationary fit of this cost, ½‖r‖²; `size2`: ‖data‖².

    1e-6; in single precision no less than what the rounding of model and data makes of it, and no more than 1e-3.
    """
    if is_double():
        return STATIONARY
    compared = 1.0 + np.sqrt(target_norm_squared / max(2.0 * cost, 1e-300))
    return float(np.clip(SINGLE * eps() * compared, STATIONARY, 1e-3))


def is_exact(cost: float, target_norm_squared: float) -> bool:
    """‖r‖ ≤ 10³ eps ‖data‖: the residual is rounding."""
    return 2.0 * cost <= (EXACT * eps()) ** 2 * target_norm_squared
