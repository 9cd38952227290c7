"""The solver on problems that are not models: whatever has normal equations and domains."""

import dataclasses

import numpy as np
import pytest

from gonio.fitting.problem.arrow import Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import LINEAR, LOG, Domains
from gonio.fitting.solver.levenberg_marquardt import Stopping, minimise

DOMAINS = Domains(np.array([LINEAR, LOG]), np.array([0.0, 1e-3]), np.array([10.0, 1e3]))


@dataclasses.dataclass
class Exponential:
    """a·exp(−t/b) to readings y (n,), with a ≥ 0 linear; nothing finite where b > `cliff`."""

    y: np.ndarray
    cliff: float = np.inf
    refused: int = 0

    domains = DOMAINS
    linear, order = np.array([True, False]), np.arange(2)

    @property
    def target_norm_squared(self):
        return float(np.sum(self.y**2))

    def normal_equations(self, p, active=None):
        t = np.arange(self.y.size)
        shape = np.exp(-t / p[:, 1:])
        rows = np.stack([shape, p[:, :1] * shape * t / p[:, 1:] ** 2], axis=-1)
        r = p[:, :1] * shape - self.y
        off = p[:, 1] > self.cliff
        self.refused += int(np.count_nonzero(off))
        r[off] = np.nan
        cost = 0.5 * np.sum(r * r, axis=1)
        matrix = Arrow.dense(np.einsum("snp,snq->spq", rows, rows))
        return NormalEquations(cost, np.einsum("snp,sn->sp", rows, r), matrix)


@dataclasses.dataclass
class Valley:
    """s·(f + (1 − f)·c) to readings y (n,), s ≥ 0 linear and f in [0, 1]: c so small that s·f alone is well known."""

    y: np.ndarray
    c: np.ndarray

    domains = Domains(np.array([LINEAR, LINEAR]), np.array([0.0, 0.0]), np.array([1e3, 1.0]))
    linear, order = np.array([True, False]), np.arange(2)

    @property
    def target_norm_squared(self):
        return float(np.sum(self.y**2))

    def normal_equations(self, p, active=None):
        s, f = p[:, :1], p[:, 1:]
        shape = f + (1 - f) * self.c
        rows, r = np.stack([shape, s * (1 - self.c)], axis=-1), s * shape - self.y
        matrix = Arrow.dense(np.einsum("snp,snq->spq", rows, rows))
        return NormalEquations(0.5 * np.sum(r * r, axis=1), np.einsum("snp,sn->sp", rows, r), matrix)


@pytest.mark.parametrize("tilt", [1.0, -1.0])
def test_a_valley_that_bends_is_followed_to_its_end(tilt):
    """The best s of each f is a quotient of sums: the end is known without a descent."""
    c = np.linspace(0, 1, 400) ** 3 * 1e-3
    y = 0.6 * (0.1 + 0.9 * c) + 1e-2 * np.cos(1e3 * np.arange(400.0) ** 2) + tilt * 2e-1 * (c - c.mean())
    ends = minimise(Valley(y, c), np.array([[2.0, 0.04], [0.2, 0.7]]))
    f = np.linspace(0, 1, 20001)
    shape = f[:, None] + (1 - f[:, None]) * c
    best = 0.5 * np.min(y @ y - (shape @ y) ** 2 / np.sum(shape**2, axis=1))
    assert all(e.successful for e in ends)
    np.testing.assert_allclose([e.cost for e in ends], best, rtol=1e-9)


DECAY = 0.7 * np.exp(-np.arange(30) / 4.0)


def test_descents_side_by_side_arrive():
    """More starts than the solver takes at a time."""
    rng = np.random.default_rng(0)
    starts = np.stack([rng.uniform(0, 10, 20), 10 ** rng.uniform(0, 1.2, 20)], axis=1)
    ends = minimise(Exponential(DECAY), starts)
    assert all(e.successful for e in ends)
    np.testing.assert_allclose([e.p for e in ends], [[0.7, 4.0]] * 20, rtol=1e-7)


def test_a_value_that_is_no_number_is_a_refused_step():
    """A model that breaks down beyond some value: the descent turns back and arrives."""
    problem = Exponential(DECAY, cliff=6.0)
    ends = minimise(problem, np.array([[0.5, 1.5], [3.0, 5.9]]))
    assert problem.refused and all(e.successful for e in ends)
    np.testing.assert_allclose([e.p for e in ends], [[0.7, 4.0]] * 2, rtol=1e-7)


def test_a_bound_is_reached():
    ends = minimise(Exponential(-DECAY), [np.array([1.0, 2.0])])
    assert ends[0].p[0] == pytest.approx(0.0, abs=1e-9) and ends[0].successful


def test_rivals_that_cannot_win_stop_early():
    """A descent that begins at the minimum ends the others."""
    starts = [np.array([0.7, 4.0]), np.array([9.0, 500.0])]
    alone, rivals = (minimise(Exponential(DECAY + 0.01), starts, Stopping(near=True, rivals=r)) for r in (False, True))
    assert rivals[0].cost == pytest.approx(alone[0].cost) and rivals[1].steps <= alone[1].steps


def test_descents_stop_where_they_have_said_enough():
    """One has reached the cost that it was to reach, the other will not come down to its own; the third goes on."""
    starts = [np.array([1.0, 3.0]), np.array([9.0, 500.0]), np.array([1.0, 3.0])]
    problem = Exponential(DECAY + 0.01)
    whole = minimise(problem, starts, Stopping(near=True))
    enough = np.array([3.0 * whole[0].cost, -np.inf, -np.inf]), np.array([np.inf, 0.5 * whole[1].cost, np.inf])
    some = minimise(problem, starts, Stopping(near=True, below=enough[0], above=enough[1]))
    assert some[0].cost <= 3.0 * whole[0].cost and some[0].steps < whole[0].steps
    assert some[1].steps < whole[1].steps
    assert some[2].steps == whole[2].steps and np.array_equal(some[2].p, whole[2].p)
