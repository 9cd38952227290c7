"""Sums by loops are those of the residuals and derivatives in NumPy, of each candidate alone and of several at once."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.fitting.selection.candidate_columns import candidate_parameters
from gonio.fitting.selection.candidate_model import CandidateProblem, SelectionData, sums_together
from gonio.fitting.selection.term_spec import LAMBERT, METAL, NO_FRESNEL, SCHLICK, SCHLICK_FREE, Terms, TermSpec

WI, WO = layouts.spherical(
    np.radians([10, 50.0]), np.radians([0, 70.0]), np.radians([0, 30, 60.0]), np.radians(np.arange(0, 360, 60.0))
).directions()
SHAPE = (WI.z.size, 3)
CANDIDATES: list[Terms] = [
    (LAMBERT,),
    (TermSpec("lambert", shared=True), TermSpec("ggx", SCHLICK, width_each=True, shared=True)),
    (LAMBERT, TermSpec("ggx", SCHLICK_FREE, anisotropic=True), TermSpec("ggx", NO_FRESNEL)),
    (LAMBERT, TermSpec("ggx", METAL)),
    (TermSpec("ggx", NO_FRESNEL), TermSpec("lambert_transmission")),
]


def numbers(terms: Terms, rng: np.random.Generator, sets: int) -> np.ndarray:
    free = candidate_parameters(terms, 3).parameterisation
    return rng.uniform(0.3, 0.9, (sets, free.order.size))


def data(loss: str, rng: np.random.Generator) -> SelectionData:
    """Readings, some of them of no weight and without a value."""
    weight = rng.uniform(0.0, 2.0, SHAPE) * (rng.random(SHAPE) < 0.8)
    f = np.where(weight > 0, rng.uniform(0.1, 0.5, SHAPE), 0.0)
    return SelectionData.of(WI, WO, f, weight, loss, 1e-2)


@pytest.mark.parametrize("loss", ["linear", "cbrt"])
def test_sums_are_those_of_residuals_and_derivatives(loss):
    rng = np.random.default_rng(1)
    readings = data(loss, rng)
    problems = [CandidateProblem(terms, readings) for terms in CANDIDATES]
    p = [numbers(terms, rng, 2) for terms in CANDIDATES]
    rows = np.full((len(problems), 16), 0.5)
    for row, problem, of_problem in zip(rows, problems, p, strict=True):
        row[: problem.order.size] = of_problem[0][problem.order]
    sums = sums_together(problems, 16)
    together = None if sums is None else sums.equations(rows, np.array([True, False, True, True, True]))
    for k, (problem, of_problem) in enumerate(zip(problems, p, strict=True)):
        alone, order = problem.normal_equations(of_problem), problem.order
        for s, (r, jacobian) in enumerate(map(problem.residuals, of_problem)):
            r, jacobian = r.ravel(), jacobian.reshape(r.size, -1)[:, order]
            expected = 0.5 * r @ r, jacobian.T @ r, jacobian.T @ jacobian
            got = [alone.cost[s], alone.gradient[s], alone.matrix.whole()[s]]
            for a, b in zip(got, expected, strict=True):
                np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
            if together is not None and s == 0 and k != 1:
                size = order.size
                got = [together.cost[k], together.gradient[k, :size], together.matrix.whole()[k, :size, :size]]
                for a, b in zip(got, expected, strict=True):
                    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
                assert not together.gradient[k, size:].any() and not together.matrix.whole()[k, size:].any()
    assert together is None or not together.cost[1]
