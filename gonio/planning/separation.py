"""T-optimal design: shares of the time that tell a model apart from a rival, whatever the rival's numbers.

The criterion T(w) = min over the rival's numbers θ of Σ w_k d_k(θ), d the squared difference of both models in standard
uncertainties, is a minimum of linear functions of the shares: each θ gives a bound from above. A linear programme
finds the shares of the highest bound, the rival's best numbers for these give the next one [Kelley 1960; Atkinson &
Fedorov 1975], until bound and criterion meet: the certificate.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import linprog

from gonio.planning.design import GAP, Design

MOST_CUTS = 60

Squares = Callable[[np.ndarray], tuple[np.ndarray, float]]
"""Of shares (k,): d (k,) at the rival's best numbers for them, and the same sum over what is read in any case."""


def separating_design(squares: Squares, count: int) -> Design:
    """The T-optimal shares of `count` candidates; the residual is what no others could gain."""
    even = np.full(count, 1 / count)
    best, lower, upper = even, -np.inf, np.inf
    cuts: list[tuple[np.ndarray, float]] = []
    trial = even
    for number in range(MOST_CUTS):
        d, fixed = squares(trial)
        cuts.append((d, fixed))
        if trial @ d + fixed > lower:
            best, lower = trial, float(trial @ d + fixed)
        if upper - lower <= GAP * lower:
            break
        corner, upper = _highest(cuts, count)
        # In turns the corner itself, which lowers the bound, and a step towards it, which raises the criterion.
        trial = corner if number % 2 else 0.5 * (corner + best)
    return Design(best, upper - lower, lower)


def _highest(cuts: list[tuple[np.ndarray, float]], count: int) -> tuple[np.ndarray, float]:
    """Shares of the highest bound that all linear functions allow, and that bound."""
    scale = max(float(np.max(cuts[-1][0])), cuts[-1][1], 1e-300)
    slopes = np.stack([d for d, _ in cuts]) / scale
    limits = np.array([fixed for _, fixed in cuts]) / scale
    height = np.zeros(count + 1)
    height[-1] = -1.0
    whole = np.ones((1, count + 1))
    whole[0, -1] = 0.0
    above = np.concatenate([-slopes, np.ones((len(cuts), 1))], axis=1)
    bounds = (0.0, None)  # their sum keeps the shares below 1
    result = linprog(height, above, limits, whole, [1.0], bounds, method="highs")
    shares = np.maximum(result.x[:-1], 0.0)
    return shares / shares.sum(), float(result.x[-1]) * scale
