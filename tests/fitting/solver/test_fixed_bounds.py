"""The last steps of a fit whose minimum lies on bounds."""

import dataclasses

import numpy as np
import pytest

from gonio.fitting.problem.arrow import Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import LINEAR, Domains
from gonio.fitting.solver.fixed_bounds import with_bounds_fixed

DOMAINS = Domains(np.full(2, LINEAR), np.array([0.5, 0.0]), np.array([1.0, 5.0]))


@dataclasses.dataclass(frozen=True)
class Valley:
    """r = (10⁵ (x y − 1), 10⁻² (x − 2)) with x in [½, 1]: its bottom, y = 1/x, falls towards x = 1, y = 1."""

    domains: Domains = DOMAINS
    target_norm_squared: float = 1e10
    linear, order = np.zeros(2, bool), np.arange(2)

    def normal_equations(self, p, active=None):
        (x, y), no = p.T, np.zeros(len(p))
        r = np.stack([1e5 * (x * y - 1), 1e-2 * (x - 2)], axis=-1)
        rows = np.stack([np.stack([1e5 * y, 1e5 * x], -1), np.stack([no + 1e-2, no], -1)], axis=-2)
        matrix = Arrow.dense(np.swapaxes(rows, 1, 2) @ rows)
        return NormalEquations(0.5 * np.sum(r * r, axis=1), (r[:, None] @ rows)[:, 0], matrix)


def test_what_a_bound_moves_off_the_bottom_of_a_valley_comes_back_to_it():
    problem = Valley()
    # From (1 − 1e-10, 1 + 1e-10), on the bottom, the first number was put on its bound.
    end = with_bounds_fixed(problem, np.array([1.0, 1.0 + 1e-10]))
    assert end is not None and end.p[0] == 1.0
    assert abs(end.p[1] - 1.0) < 1e-15 and end.cost == pytest.approx(0.5e-4, rel=1e-12)


def test_inside_all_bounds_nothing_is_held():
    assert with_bounds_fixed(Valley(), np.array([0.75, 4 / 3])) is None
