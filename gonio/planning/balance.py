"""How much of a plan is for the likeliest numbers, and how much for the ends of their ranges."""

import numpy as np
from jaxtyping import Float

from gonio.planning.design import Problem, criterion, optimal_design, scaled

MOST_LOSS = 1.75
"""Hours at an end of the ranges, over those of a plan that is made for it."""
LEAST, MOST, STEPS = 0.5, 0.9, 4
"""Of what the likeliest numbers count for; halvings of what is between."""
EVERY = 4
"""One of so many candidates is looked at: hours need not be known to the last percent."""


def balanced(problem: Problem) -> Float[np.ndarray, " s"]:
    """What each draw counts for: the first, the likeliest, as much as costs none of the others too many hours.

    At least `LEAST`, even where that costs one of them more than `MOST_LOSS` times the hours of a plan made for it.
    """
    problem = scaled(problem.part(np.arange(0, problem.rows.shape[1], EVERY)))
    draws = len(problem.rows)
    if draws == 1:
        return np.ones(1)
    each = [_of_draw(problem, s) for s in range(1, draws)]
    best = [criterion(one, optimal_design(one).shares).value for one in each]
    allowed = np.log(MOST_LOSS) * (problem.size if problem.wanted is None else 1)
    low, high = LEAST, MOST
    for _ in range(STEPS):
        share = (low + high) / 2
        design = optimal_design(problem._replace(of_draws=_shares(share, draws))).shares
        lost = max(b - criterion(one, design).value for b, one in zip(best, each, strict=True))
        low, high = (share, high) if lost <= allowed else (low, share)
    return _shares(low, draws)


def _shares(likeliest: float, draws: int) -> Float[np.ndarray, " s"]:
    return np.append(likeliest, np.full(draws - 1, (1 - likeliest) / (draws - 1)))


def _of_draw(problem: Problem, s: int) -> Problem:
    """The same for one draw alone."""
    wanted = None if problem.wanted is None else problem.wanted[s : s + 1]
    fixed = np.broadcast_to(problem.fixed, (len(problem.rows), *problem.fixed.shape[1:]))
    return Problem(problem.rows[s : s + 1], fixed[s : s + 1], problem.size, wanted)
