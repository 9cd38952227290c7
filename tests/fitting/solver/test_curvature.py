"""Descents that Gauss–Newton steps do not end: their residuals are curved as much as their cost is."""

import dataclasses

import numpy as np
import pytest

from gonio.fitting.problem.arrow import Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import LINEAR, Domains
from gonio.fitting.solver.curvature import completed
from gonio.fitting.solver.levenberg_marquardt import NEAR, minimise


@dataclasses.dataclass
class Parabola:
    """r = (p + 1, b p² + p − 1): least at p = 0 for b < 1, where Gauss–Newton steps leave b of the error [Powell]."""

    bend: float

    domains = Domains(np.array([LINEAR]), np.array([-5.0]), np.array([5.0]))
    linear, order = np.array([False]), np.arange(1)
    target_norm_squared = 2.0

    def normal_equations(self, p, active=None):
        p = p[:, 0]
        r = np.stack([p + 1, self.bend * p * p + p - 1], axis=-1)
        row = np.stack([np.ones_like(p), 2 * self.bend * p + 1], axis=-1)
        matrix = Arrow.dense(np.einsum("sn,sn->s", row, row)[:, None, None])
        return NormalEquations(0.5 * np.sum(r * r, axis=1), np.einsum("sn,sn->s", row, r)[:, None], matrix)


@pytest.mark.parametrize("bend", [0.95, 0.6, -0.9])
def test_what_shrinks_slowly_or_turns_to_and_fro_is_brought_to_its_end(bend):
    problem = Parabola(bend)
    stopped = minimise(problem, [np.array([0.3])], NEAR._replace(most=8))[0]
    end = completed(problem, stopped)
    assert not stopped.successful and end.successful and end.steps <= 20
    assert abs(end.p[0]) < 1e-6 < 1e-3 < abs(stopped.p[0])


def test_what_is_no_minimum_stays_where_it_is():
    """Beyond b = 1 the cost has its maximum at 0: the curvature leaves nothing to step to, and is not used."""
    problem = Parabola(3.0)
    before = minimise(problem, [np.array([1e-3])], NEAR._replace(most=1))[0]
    assert completed(problem, before).cost <= before.cost


def test_what_leaves_nothing_to_explain_is_at_its_end():
    """Without residuals there is no curvature of them, and no step by which to look for it."""

    class Exact(Parabola):
        def normal_equations(self, p, active=None):
            matrix = Arrow.dense(np.ones((p.shape[0], 1, 1)))
            return NormalEquations(0.5 * p[:, 0] ** 2, p, matrix)

    end = minimise(Exact(0.0), [np.array([0.0])], NEAR)[0]
    stopped = dataclasses.replace(end, p=np.zeros(1), cost=0.0, successful=False)
    assert completed(Exact(0.0), stopped) is stopped
