"""Descents of several problems side by side end where those of each alone do."""

import dataclasses

import numpy as np
import pytest

from gonio.data import layouts
from gonio.fitting.problem.arrow import Arrow
from gonio.fitting.selection.candidate_columns import candidate_parameters
from gonio.fitting.selection.candidate_model import CandidateProblem, SelectionData
from gonio.fitting.selection.term_spec import DIELECTRIC, LAMBERT, SCHLICK, SCHLICK_FREE, TermSpec
from gonio.fitting.solver.levenberg_marquardt import Stopping, minimise
from gonio.fitting.solver.side_by_side import minimise_all

LAYOUT = layouts.isotropic(np.radians([5, 30, 55.0]), np.radians(np.arange(0, 80, 10.0)), np.radians([0, 60, 180.0]))
WI, WO = LAYOUT.directions()
BLANK = SelectionData.of(WI, WO, np.ones((LAYOUT.size, 3)), np.ones((LAYOUT.size, 3)), "linear", 1e-3)
TRUTH = (LAMBERT, TermSpec("ggx", SCHLICK))
CANDIDATES = [
    (LAMBERT,), TRUTH, (LAMBERT, TermSpec("ggx", DIELECTRIC)), (TermSpec("eon", shared=True), TermSpec("phong")),
    (LAMBERT, TermSpec("ggx", SCHLICK_FREE, width_each=True), TermSpec("beckmann")),
]  # fmt: skip


def problems_with(count):
    f = CandidateProblem(TRUTH, BLANK).values(np.array([0.1, 0.2, 0.4, 0.3, 0.9, 0.8, 0.7]))[0]
    data = SelectionData.of(WI, WO, f, np.ones_like(f), "cbrt", 1e-3)
    rng, problems, starts = np.random.default_rng(count), [], []
    for k in range(count):
        problem = CandidateProblem(CANDIDATES[k % len(CANDIDATES)], data)
        usual = candidate_parameters(problem.terms, 3).parameterisation.each(lambda g: g.info.start)
        problems.append(problem)
        starts.append([np.clip(usual * rng.uniform(0.5, 1.5, usual.size), *problem.domains[1:]) for _ in range(k % 3)])
    return problems, starts


@pytest.mark.parametrize("count", [1, 5, 12])
def test_each_ends_where_it_would_alone(count):
    problems, starts = problems_with(count)
    stopping = Stopping(rough=1e4, most=40)
    together = minimise_all(problems, starts, stopping)
    for problem, of_problem, ends in zip(problems, starts, together, strict=True):
        assert len(ends) == len(of_problem)
        for start, end in zip(of_problem, ends, strict=True):
            alone = minimise(problem, [start], stopping)[0]
            np.testing.assert_allclose(end.p, alone.p, rtol=1e-7, atol=1e-9)
            assert end.cost == pytest.approx(alone.cost, rel=1e-9, abs=1e-12) and end.steps == alone.steps


def test_what_has_no_finite_value_harms_no_other():
    problems, starts = problems_with(3)
    broken = dataclasses.replace(problems[1].data, target=np.full_like(problems[1].data.target, np.nan))
    expected = minimise_all(problems, starts, Stopping(rough=1e4, most=40))
    problems[1] = CandidateProblem(problems[1].terms, broken)
    ends = minimise_all(problems, starts, Stopping(rough=1e4, most=40))
    np.testing.assert_allclose(ends[2][0].p, expected[2][0].p, rtol=1e-9)
    assert not np.isfinite(ends[1][0].cost)


def test_a_singular_matrix_leaves_the_systems_beside_it_solved():
    matrices = np.array([np.diag([2.0, 4.0]), [[1.0, 1.0], [1.0, 1.0]], np.diag([1.0, 8.0])])
    x = Arrow.dense(matrices).solved(np.ones((3, 2)))
    np.testing.assert_allclose(x[[0, 2]], [[0.5, 0.25], [1.0, 0.125]])
    assert np.isnan(x[1]).all()
