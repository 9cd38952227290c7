"""Optimal designs against closed forms of textbooks, and the laws of their criterion."""

import numpy as np
import pytest

from gonio.models.errors import GonioError
from gonio.planning.design import GAP, Problem, best_shares, criterion, gram, optimal_design, require_determined

X = np.linspace(-1, 1, 401)
POLYNOMIAL = np.stack([np.ones_like(X), X, X**2], axis=-1)[None, :, None, :]


def problem(wanted=None):
    return Problem(POLYNOMIAL, np.zeros((1, 3, 3)), 3, wanted)


def near(shares, x, width=0.03):
    return shares[np.abs(X - x) < width].sum()


def test_the_d_optimal_design_of_a_parabola_is_a_third_at_both_ends_and_the_middle():
    design = optimal_design(problem())  # Atkinson, Donev & Tobias 2007, section 11
    assert [near(design.shares, x) for x in (-1, 0, 1)] == pytest.approx([1 / 3] * 3, abs=2e-3)
    assert design.scale == pytest.approx(3) and 0 <= design.residual <= GAP * 3


def test_the_design_for_the_curvature_alone_counts_the_middle_twice():
    design = optimal_design(problem(np.array([[[0.0, 0.0, 1.0]]])))  # Kiefer & Wolfowitz 1959: Chebyshev points
    assert [near(design.shares, x) for x in (-1, 0, 1)] == pytest.approx([0.25, 0.5, 0.25], abs=5e-3)
    variance = np.exp(-criterion(problem(np.array([[[0.0, 0.0, 1.0]]])), design.shares).value)
    assert variance == pytest.approx(4, rel=2e-3)


def test_no_random_design_beats_the_certified_one_by_more_than_its_residual():
    best = optimal_design(problem())
    value = criterion(problem(), best.shares).value
    rng = np.random.default_rng(1)
    for _ in range(50):
        shares = rng.dirichlet(np.full(X.size, rng.choice([0.02, 0.2])))
        assert criterion(problem(), shares).value <= value + best.residual


@pytest.mark.parametrize("combinations", [None, 2])
def test_slopes_are_those_of_differences_with_errors_that_all_readings_share(combinations):
    rng = np.random.default_rng(2)
    rows, shares = rng.normal(size=(3, 9, 2, 6)), rng.random(9)
    wanted = None if combinations is None else rng.normal(size=(3, combinations, 4))
    given = Problem(rows, gram(rng.normal(size=(3, 1, 1, 6)), np.ones(1)), 4, wanted)
    steps = 1e-6 * np.eye(9)
    differences = [criterion(given, shares + h).value - criterion(given, shares - h).value for h in steps]
    np.testing.assert_allclose(criterion(given, shares).slopes, np.array(differences) / 2e-6, rtol=1e-5, atol=1e-7)


def test_an_error_that_all_readings_share_is_balanced_rather_than_counted_down():
    # y = a + error·x: readings at both ends cancel the shift of the mean, more readings at one end never would.
    rows = np.array([[[1.0, -3.0]], [[1.0, 3.0]], [[0.9, 9.0]]])[None]
    design = optimal_design(Problem(rows, np.zeros((1, 2, 2)), 1))
    assert design.shares[0] == pytest.approx(0.5, abs=0.02) and design.shares[2] < 0.02
    few = best_shares(Problem(rows, np.zeros((1, 2, 2)), 1), np.array([0.2, 0.2, 0.6]))
    assert few == pytest.approx(design.shares, abs=0.02)


def test_a_design_that_repeats_one_direction_is_refused_with_what_it_leaves_open():
    one = gram(np.repeat(POLYNOMIAL[:, 300:301], 50, axis=1), np.ones(50))[0]
    assert criterion(problem(), np.eye(X.size)[300]).value == -np.inf
    with pytest.raises(GonioError, match=r"do not determine a, b, c together"):
        require_determined(one, ["a", "b", "c"])
    with pytest.raises(GonioError, match="do not determine b at all"):
        require_determined(np.diag([1.0, 0.0, 2.0]), ["a", "b", "c"])
