"""The compiled loop of a step is what NumPy makes of the same formulas, operation by operation."""

import functools

import jax
import numpy as np
import pytest

from gonio.fitting.problem.arrow import Arrow, Sizes
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import LINEAR, LOG, LOG1P, Domains, to_parameters, to_unconstrained
from gonio.fitting.solver.compiled_steps import KNOWN, StepsByLoop, _rows, steps_of
from gonio.fitting.solver.xla_steps import Descents, StepsByXLA
from gonio.models.compiled import known

DOMAINS = Domains(np.array([LINEAR, LOG, LOG1P]), np.array([0.0, 1e-3, 0.0]), np.array([1.0, 1.0, 1e3]))
TRUTH = np.array([0.3, 0.05, 2.0])
AT = np.linspace(0.0, 3.0, 40)
DATA = 0.3 + 2.0 * np.exp(-AT * 0.05) + 0.02 * np.cos(7 * AT)


def equations_at(p: np.ndarray) -> NormalEquations:
    """Of a + c exp(−b x) beside the data, at vectors (a, b, c), (S, 3)."""
    a, b, c = p.T[..., None]
    decay = np.exp(-b * AT)
    jacobian = np.stack([np.ones_like(decay), -c * AT * decay, decay], axis=-1)
    r = a + c * decay - DATA
    matrix = jacobian.swapaxes(1, 2) @ jacobian
    return NormalEquations(0.5 * (r * r).sum(1), (jacobian * r[..., None]).sum(1), Arrow.dense(matrix))


def descents() -> Descents:
    """Three starts, one of them on a bound's edge."""
    start = np.array([[0.5, 1.0, 0.1], [1.5, 0.2, 0.02], [1e-6, 0.7, 0.4]])
    return Descents(DOMAINS, np.array([True, False, True]), start, 100.0, float(DATA @ DATA), 1.0)


@pytest.fixture
def by_loop() -> StepsByLoop:
    steps = steps_of(descents(), Sizes(3, 0, 0))
    if not isinstance(steps, StepsByLoop):
        pytest.skip("no compiled loops on this processor")
    return steps


def test_steps_are_those_of_the_same_formulas_in_numpy(by_loop):
    by_loop(equations_at(by_loop.p), np.array([True, True, False]))
    by_loop(equations_at(by_loop.p), np.ones(3, bool))
    of = by_loop.layout
    before = np.delete(by_loop.numbers[0], np.arange(of.lane, of.lane + KNOWN))
    by_loop(equations_at(by_loop.p), np.ones(3, bool))
    numbers = [*by_loop.scalars, *before, *by_loop.given[0]]
    (reference,) = known.program(
        jax.make_jaxpr(functools.partial(_rows, of))([], *numbers), list(map(np.asarray, numbers))
    )
    np.testing.assert_allclose(by_loop.after[0], reference, rtol=1e-7, atol=1e-13)


def test_descents_that_have_ended_stay_where_they_are(by_loop):
    p = by_loop.p
    report = by_loop(equations_at(p), np.array([True, False, True]))
    assert np.array_equal(report.p[1], p[1])
    assert (report.p[[0, 2]] != p[[0, 2]]).any(axis=1).all()


def test_a_step_many_periods_away_is_the_loops_and_comes_back(by_loop):
    """Such steps came of slopes that nearly vanish; sines of what is so far away are not the loop's."""
    of = by_loop.layout
    far = of.lane_of(by_loop.numbers[:, : of.lane])
    far.trial[0, :3] += 1e7 * np.pi
    report = by_loop(equations_at(by_loop.p), np.ones(3, bool))
    assert by_loop.otherwise is None and report.accepted[0]
    assert np.abs(of.lane_of(by_loop.numbers[:, : of.lane]).y[0, :3]).max() <= 2.0


def test_goes_on_by_xla_where_the_loop_is_not_sure(by_loop, monkeypatch):
    before = by_loop(equations_at(by_loop.p), np.ones(3, bool))
    monkeypatch.setattr(by_loop, "program", lambda *_: None)
    monkeypatch.setattr(StepsByXLA, "__call__", lambda self, equations, active: self)
    there = by_loop(equations_at(by_loop.p), np.ones(3, bool))
    np.testing.assert_allclose(to_parameters(DOMAINS, there.trial, np).p, before.p, rtol=1e-12)
    assert np.array_equal(there.lanes.accepted[:3], before.accepted)
    np.testing.assert_allclose(there.lanes.normal.cost[:3], before.points.cost)


def test_a_start_without_a_finite_cost_is_refused(by_loop):
    equations = equations_at(to_parameters(DOMAINS, descents().start, np).p)
    equations.cost[1] = np.nan
    report = by_loop(equations, np.ones(3, bool))
    assert report.refused.tolist() == [False, True, False]


@pytest.mark.parametrize("size", [13, 16])
def test_many_numbers_come_to_least_squares_by_the_loop(size):
    rng = np.random.default_rng(size)
    rows, data = rng.standard_normal((40, size)), rng.standard_normal(40)
    domains = Domains(np.full(size, LINEAR), np.full(size, -9.0), np.full(size, 9.0))

    def equations(p: np.ndarray) -> NormalEquations:
        r = p @ rows.T - data
        return NormalEquations(0.5 * (r * r).sum(1), r @ rows, Arrow.dense(np.stack([rows.T @ rows] * len(p))))

    start = to_unconstrained(domains, rng.uniform(-1.0, 1.0, (2, size)))
    steps = steps_of(Descents(domains, np.ones(size, bool), start, 100.0, float(data @ data), 1.0), Sizes(size, 0, 0))
    if not isinstance(steps, StepsByLoop):
        pytest.skip("no compiled loops on this processor")
    for _ in range(12):
        report = steps(equations(steps.p), np.ones(2, bool))
    assert report.finished.all() and steps.otherwise is None
    np.testing.assert_allclose(report.points.p, np.stack([np.linalg.lstsq(rows, data)[0]] * 2), rtol=1e-6)
