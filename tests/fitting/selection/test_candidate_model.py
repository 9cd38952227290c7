"""Candidates of a selection: the values of the models they stand for, derivatives, bounds, and starts."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.fitting.selection.candidate_columns import candidate_parameters
from gonio.fitting.selection.candidate_model import CandidateProblem, SelectionData
from gonio.fitting.selection.criteria import holdout_chi2, neighbourhood
from gonio.fitting.selection.term_spec import (
    DIELECTRIC,
    LAMBERT,
    METAL,
    SCHLICK,
    SCHLICK_FREE,
    Terms,
    TermSpec,
    expression_of,
    families,
    simpler,
    steps,
)
from gonio.fitting.selection.warm_start import carried, fit_candidate
from gonio.fitting.solver.levenberg_marquardt import minimise
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.expression.parser import parse, with_defaults

THETA = np.radians(np.arange(0, 81, 20.0))
LAYOUT = layouts.spherical(THETA, np.radians([0, 60, 120.0]), THETA, np.radians(np.arange(0, 360, 40.0)))
WI, WO = LAYOUT.directions()
MIXED = (
    TermSpec("lambert", shared=True),
    TermSpec("ggx", SCHLICK, width_each=True),
    TermSpec("ggx", SCHLICK_FREE, anisotropic=True),
)
MIXED_P = np.array([0.2, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.1, 0.25, 0.5, 0.2, 0.3, 0.1])
MIXED_EXPRESSION = (
    "lambert(rho=0.2) + [0.5, 0.6, 0.7] * ggx(alpha=[0.3, 0.35, 0.4], f0=0.04)"
    " + [0.2, 0.3, 0.1] * ggx(alpha_x=0.1, alpha_y=0.25, f0=0.5)"
)
SEVEN = (LAMBERT, TermSpec("ggx", SCHLICK))
SEVEN_P = np.array([0.1, 0.2, 0.4, 0.3, 0.9, 0.8, 0.7])
BLANK = SelectionData.of(WI, WO, np.ones((LAYOUT.size, 3)), np.ones((LAYOUT.size, 3)), "linear", 1e-3)


def data_of(terms: Terms, p: np.ndarray, noise: float = 0.0, loss: str = "linear") -> SelectionData:
    f = CandidateProblem(terms, BLANK).values(p)[0]
    f = f * (1 + noise * np.random.default_rng(0).standard_normal(f.shape))
    return SelectionData.of(WI, WO, f, np.ones_like(f), loss, 1e-3)


def test_a_candidate_is_the_model_of_its_expression():
    assert expression_of(MIXED) == ("lambert(rho=shared) + ggx(alpha=each, f0=0.04) + ggx(alpha_x=?, alpha_y=?, f0=?)")
    f = CandidateProblem(MIXED, BLANK).values(MIXED_P)[0]
    np.testing.assert_allclose(f, evaluate(build(MIXED_EXPRESSION), WI, WO), rtol=1e-12)


def test_derivatives_are_those_of_finite_differences():
    problem = CandidateProblem(MIXED, data_of(SEVEN, SEVEN_P, loss="cbrt"))
    jacobian = problem.residuals(MIXED_P)[1]
    for j, step in enumerate(1e-6 * np.eye(MIXED_P.size)):
        slope = (problem.residuals(MIXED_P + step)[0] - problem.residuals(MIXED_P - step)[0]) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, j], slope, rtol=1e-5, atol=1e-7)


def test_a_descent_finds_the_truth_and_stops_on_bounds():
    problem = CandidateProblem(SEVEN, data_of(SEVEN, SEVEN_P, loss="cbrt"))
    p, chi2 = fit_candidate(problem, np.array([0.3, 0.3, 0.3, 0.6, 0.2, 0.2, 0.2]))
    np.testing.assert_allclose(p, SEVEN_P, rtol=1e-6)
    assert chi2 < 1e-12
    p, _ = fit_candidate(CandidateProblem(SEVEN, data_of((LAMBERT,), np.array([0.0, 0.2, 0.4]))), SEVEN_P)
    assert p[0] == 0.0 and (p[:3] <= 1).all()


def test_a_new_lobe_starts_where_the_data_put_it():
    start = carried((LAMBERT,), np.array([0.3, 0.3, 0.3]), SEVEN, 3)
    assert np.isnan(start[3:]).all()
    problem = CandidateProblem(SEVEN, data_of(SEVEN, SEVEN_P, loss="cbrt"))
    np.testing.assert_allclose(fit_candidate(problem, start).p, SEVEN_P, rtol=1e-6)


def test_numbers_are_carried_between_shared_and_separate_ones():
    each = (LAMBERT, TermSpec("ggx", SCHLICK, width_each=True))
    np.testing.assert_array_equal(carried(SEVEN, SEVEN_P, each, 3)[3:6], 0.3)
    back = carried(each, np.array([0.1, 0.2, 0.4, 0.2, 0.3, 0.4, 0.9, 0.8, 0.7]), SEVEN, 3)
    np.testing.assert_allclose(back, SEVEN_P)
    brushed = carried(SEVEN, SEVEN_P, (LAMBERT, TermSpec("ggx", SCHLICK, anisotropic=True)), 3)[3:5]
    assert brushed[0] < 0.3 < brushed[1] and np.prod(brushed) == pytest.approx(0.3**2)


@pytest.mark.parametrize(("terms", "p", "tolerance"), [((LAMBERT,), SEVEN_P[:3], 1e-6), (SEVEN, SEVEN_P, 0.05)])
def test_cross_validation_is_that_of_refits(terms, p, tolerance):
    """The closed form against refits: exact for a linear model, within a few per cent for a lobe's width."""
    data, groups = data_of(SEVEN, SEVEN_P, noise=0.05), neighbourhood(WI, WO).groups
    problem = CandidateProblem(terms, data)
    p = minimise(problem, [p])[0].p
    closed = holdout_chi2(*problem.residuals(p), groups)
    for g in (0, 4, int(groups.max())):
        others = CandidateProblem(terms, data.weighted(np.repeat((groups != g)[:, None], 3, axis=1).astype(float)))
        without = minimise(others, [p])[0].p
        assert closed[g] == pytest.approx(np.sum(problem.residuals(without)[0][groups == g] ** 2), rel=tolerance)


@pytest.mark.parametrize(
    ("terms", "p", "expression"),
    [
        ((LAMBERT, TermSpec("ggx", DIELECTRIC)), [0.1, 0.2, 0.4, 0.3, 1.4], "lambert + 1 * ggx(eta=?)"),
        (
            (TermSpec("beckmann", METAL, separable=True),),
            [0.3, 0.2, 1.0, 1.5, 3.0, 2.0, 4.0],
            '1 * beckmann(eta=each, k=each, smith="separable")',
        ),
        ((TermSpec("white_standard"), TermSpec("retro")), [0.9, 0.8, 0.7, 0.1, 0.01, 0.02, 0.03], None),
        ((TermSpec("rpv", shared=True), TermSpec("phong", shared=True)), [0.2, 0.8, -0.1, 0.5, 12.0, 0.1], None),
    ],
)
def test_every_kind_of_term_is_the_model_of_its_expression(terms, p, expression):
    p = np.array(p)
    assert expression in (None, expression_of(terms))
    numbers = candidate_parameters(terms, 3)
    filled = numbers.parameterisation.filled(with_defaults(parse(expression_of(terms))), [p])
    f = CandidateProblem(terms, BLANK).values(p)[0]
    expected = np.asarray(evaluate(build(filled), WI, WO)).reshape(LAYOUT.size, -1)
    np.testing.assert_allclose(f, np.broadcast_to(expected, f.shape), rtol=1e-9)


def test_every_move_gives_an_expression_that_a_fit_can_read():
    """From candidates of several kinds: moves up lead to another model, and moves down to one of no more numbers."""
    start = [(LAMBERT,), SEVEN, MIXED, (TermSpec("eon"), TermSpec("std", SCHLICK)), (TermSpec("ggx", METAL),)]
    for terms in start:
        size = candidate_parameters(terms, 3).parameterisation.size
        for more in (*steps(terms, True, 3), *families(terms)):
            assert more != terms and candidate_parameters(more, 3).parameterisation.size > 0
        for fewer in simpler(terms, 3):
            assert candidate_parameters(fewer, 3).parameterisation.size <= size
