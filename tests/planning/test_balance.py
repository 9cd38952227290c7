"""What the likeliest numbers count for in a plan, beside what a plan for them alone would cost elsewhere."""

import numpy as np
import pytest

from gonio.planning.balance import LEAST, MOST, MOST_LOSS, balanced
from gonio.planning.design import Problem, optimal_design

X = np.linspace(0.01, 10, 400)


def decay(rates):
    """Slopes of exp(−k x) by k: the best place for a rate k is x = 1/k."""
    rows = np.stack([X * np.exp(-k * X) for k in rates])[:, :, None, None]
    return Problem(rows, np.zeros((len(rates), 1, 1)), 1)


@pytest.mark.parametrize("wanted", [False, True])
def test_no_draw_loses_more_than_is_allowed_and_more_would_cost_that(wanted):
    problem = decay([1.0, 0.48, 2.1])._replace(fixed=np.zeros((1, 1, 1)))
    if wanted:
        problem = problem._replace(wanted=np.ones((3, 1, 1)))
    shares = balanced(problem)
    assert shares.sum() == pytest.approx(1) and LEAST < shares[0] < MOST and shares[1] == shares[2]

    def lost(of_draws):
        design = optimal_design(problem._replace(of_draws=of_draws)).shares
        information = problem.rows[1:, :, 0, 0] ** 2
        return np.max(information.max(axis=1) / (information @ design))

    # Designs within the gap of the optimum share what they lose a little differently.
    assert lost(shares) <= 1.1 * MOST_LOSS < lost(np.array([1.0, 0.0, 0.0]))


def test_draws_that_agree_leave_the_likeliest_as_much_as_there_is_and_others_half():
    assert balanced(decay([1.0, 0.99, 1.01]))[0] == pytest.approx(MOST, abs=0.03)
    assert balanced(decay([1.0, 0.03, 30.0]))[0] == LEAST
    assert balanced(decay([1.0])) == pytest.approx([1.0])
