"""The nearest point of a polyhedron in a weighted norm, by Newton's method on the dual: few constraints, many numbers.

    minimise ½ Σ w (y − y₀)²   subject to   A y ≤ b  and, if asked, y ≥ 0.

With multipliers λ ≥ 0, y(λ) = y₀ − Aᵀλ/w, cut at 0 if asked, and the dual is concave, differentiable and piecewise
quadratic in λ alone: a semismooth Newton method ends in few steps [Qi & Sun 1993]. It finds the same point as
alternating projections with Dykstra's correction [Boyle & Dykstra 1986], which take thousands of sweeps.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse

STEPS, TOLERANCE = 200, 1e-12


class Projection(NamedTuple):
    """The nearest point, its multipliers, the steps taken, and by how much the worst constraint is still missed."""

    point: np.ndarray
    multipliers: np.ndarray
    steps: int
    missed: float


def nearest(
    start: np.ndarray, weight: np.ndarray, rows: sparse.csr_array, limit: np.ndarray, nonnegative: bool = False
) -> Projection:
    """The point nearest to `start` (n,), in the norm of `weight` (n,) > 0, with rows @ y ≤ limit (m,), absolute."""
    multipliers = np.zeros(limit.size)

    def point(lam: np.ndarray) -> np.ndarray:
        y = start - (rows.T @ lam) / weight
        return np.maximum(y, 0.0) if nonnegative else y

    def dual(lam: np.ndarray, y: np.ndarray) -> float:
        return 0.5 * np.sum(weight * (y - start) ** 2) + lam @ (rows @ y - limit)

    y = point(multipliers)
    steps = 0
    for steps in range(STEPS):  # noqa: B007
        over = rows @ y - limit
        slack = np.where(multipliers > 0, np.abs(over), np.maximum(over, 0.0))
        if not slack.size or slack.max() <= TOLERANCE:
            break
        active = np.flatnonzero((multipliers > 0) | (over > 0))
        some = rows[active]
        moving = np.where(y > 0, 1.0, 0.0) if nonnegative else 1.0
        hessian = (some.multiply(moving / weight) @ some.T).toarray()
        hessian[np.diag_indices_from(hessian)] *= 1 + 1e-12
        direction = np.linalg.lstsq(hessian, over[active], rcond=1e-14)[0]
        value, size = dual(multipliers, y), 1.0
        while True:
            trial = multipliers.copy()
            trial[active] = np.maximum(trial[active] + size * direction, 0.0)
            y_trial = point(trial)
            if dual(trial, y_trial) >= value - 1e-12 * abs(value) or size < 1e-6:
                break
            size /= 2
        multipliers, y = trial, y_trial
    missed = float(np.max(rows @ y - limit, initial=0.0))
    return Projection(y, multipliers, steps, missed)
