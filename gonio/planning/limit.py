"""What no measurement goes below: the least variance that shots of some hours leave, were there no way between them."""

import numpy as np

from gonio.planning.design import FEW, Problem, covariance, criterion, gram, optimal_design
from gonio.planning.planner import Planner
from gonio.planning.shots import LEAST_SECONDS, Sites

TIMES = 200
"""Counting times that are compared."""


def least_variance(planner: Planner, budget: float) -> float:
    """Variance below which no measurement of some hours goes, by a plan's criterion (`Planner.mean_variance`).

    The best counting times in the planner's candidates for numbers that are known beforehand, by an instrument that
    settles but whose axes are in place at once: the duality gap of that design is taken off.

    Args:
        planner: model, instrument and purpose; NaN where a rival or systematic errors are in it, for then the criterion
            is not convex.
        budget: seconds of counting and settling.

    References:
        Kiefer & Wolfowitz 1960; Pukelsheim 1993, ch. 5 and 7.
    """
    if planner.rival is not None or planner.candidates.shifts.shape[-1]:
        return float("nan")
    wanted = None if planner.wanted is None else planner.wanted[:1]
    rates = _rates(planner.candidates, budget)
    number = rates.shape[1]
    # What little is read of all besides takes nothing from the bound, and no number stays open.
    problem = Problem(rates, planner.before + FEW * gram(rates, np.full(number, 1 / number)), planner.size, wanted)
    design = optimal_design(problem)
    whole = problem.fixed + gram(rates, design.shares)
    slopes, scale = criterion(problem, design.shares).slopes, planner.size if wanted is None else 1
    gap = float(slopes.max() - design.shares @ slopes)
    return planner.mean_variance(covariance(whole, planner.size)[0][0]) * max(1.0 - gap / scale, 0.0)


def _rates(sites: Sites, budget: float) -> np.ndarray:
    """Rows (1, n, C, P) at the likeliest numbers if the whole budget went to one direction, and each channel alone."""
    settling = sites.instrument.pace.settling
    rate = np.zeros(sites.f.shape[1:])
    for seconds in np.geomspace(LEAST_SECONDS, max(budget, 2 * LEAST_SECONDS), TIMES):
        variance = np.maximum(sites.variance(np.full(len(rate), seconds))[0], 1e-300)
        rate = np.maximum(rate, budget / (seconds + settling) / variance)
    return sites.slopes[:1] * np.sqrt(rate)[None, ..., None]
