"""Adaptive cells against closed forms and against SciPy's cubature."""

import numpy as np
import pytest
from scipy.integrate import cubature

from gonio.stability.rectangle_cubature import fejer_rule, integrate

SQUARE, ONE_BIN = np.array([[0.0, 0.0, 1.0, 1.0]]), np.zeros(1, int)


@pytest.mark.parametrize("count", [7, 19])
def test_the_rule_is_exact_for_polynomials_and_nested(count):
    nodes, weights = fejer_rule(count)
    degrees = np.arange(count)
    exact = (1 + (-1.0) ** degrees) / (degrees + 1)
    assert weights @ nodes[:, None] ** degrees == pytest.approx(exact, abs=1e-14)
    assert nodes[1::2] == pytest.approx(fejer_rule((count - 1) // 2)[0], abs=1e-15)


def test_cells_are_halved_where_the_rules_differ():
    """∫∫ 1/√(x² + y²) over a quarter disc's square, a point singularity, and a line's kink, to closed forms."""
    (point,), error = integrate(lambda x, y: 1 / np.hypot(x, y), SQUARE, ONE_BIN, 1e-9)
    assert error < 1e-9 and point == pytest.approx(2 * np.log(1 + np.sqrt(2)), abs=1e-9)
    (kink,), _ = integrate(lambda x, y: abs(x - 0.3) + 0 * y, SQUARE, ONE_BIN, 1e-12)
    assert kink == pytest.approx(0.29, abs=1e-11)


def test_bins_are_integrated_apart():
    two, _ = integrate(lambda x, y: x * y, np.array([[0, 0, 1, 1], [1, 0, 2, 1.0]]), np.array([1, 0]), 1e-12)
    assert two == pytest.approx([0.75, 0.25])


def test_a_peak_is_integrated_as_scipy_does():
    def peak(x, y):
        return np.exp(-((x - 0.2) ** 2) / 0.01 - (y - 0.7) ** 2)

    whole = cubature(lambda p: peak(p[:, 0], p[:, 1]), [0, 0], [1, 1], rtol=1e-12, atol=0)
    assert integrate(peak, SQUARE, ONE_BIN, 1e-11).values[0] == pytest.approx(whole.estimate, abs=1e-11)
