"""Rules of pairs of directions: exact moments of points drawn evenly from two discs."""

import itertools
import math

import numpy as np
import pytest

from gonio.fitting.problem.pair_rules import COUNTS, FINENESS, LAYERED, SUMS, layered, of_sums, pair_rules

RADII = [(1.0, 1.0), (0.03, 0.05), (1.0, 0.2)]


def moment(power_x: int, power_y: int) -> float:
    """Mean of x^i y^j over the unit disc."""
    if power_x % 2 or power_y % 2:
        return 0.0
    halves = math.gamma((power_x + 1) / 2) * math.gamma((power_y + 1) / 2)
    return 2 * halves / math.gamma((power_x + power_y) / 2 + 1) / (power_x + power_y + 2) / math.pi


def worst_moment(nodes: np.ndarray, degree: int) -> float:
    """Largest error of the moments of both points up to a degree in all."""
    *components, weight = nodes
    powers = [e for e in itertools.product(range(degree + 1), repeat=4) if sum(e) <= degree]
    made = [np.sum(weight * np.prod([c**k for c, k in zip(components, e, strict=True)], axis=0)) for e in powers]
    return float(np.max(np.abs(made - np.array([moment(*e[:2]) * moment(*e[2:]) for e in powers]))))


@pytest.mark.parametrize("degree", LAYERED)
def test_layered_rules_are_exact_to_their_degree(degree: int):
    assert worst_moment(layered(degree), degree) < 1e-14 < 1e-4 < worst_moment(layered(degree), degree + 1)


@pytest.mark.parametrize("radii", RADII)
def test_rules_of_sums_are_exact_in_the_sum_and_to_degree_three_in_both(radii: tuple[float, float]):
    n, points = SUMS[0]
    nodes = of_sums(radii, n, points)
    assert worst_moment(nodes, 3) < 1e-9
    x_a, y_a, x_b, y_b, weight = nodes
    total, across = radii[0] * x_a + radii[1] * x_b, radii[0] * y_a + radii[1] * y_b
    for i, j in ((2, 0), (6, 4), (2 * n - 2, 0), (0, 2 * n - 2), (n, n - 2), (1, 2 * n - 2)):
        terms = itertools.product(range(i + 1), range(j + 1))
        exact = sum(
            math.comb(i, k) * math.comb(j, m) * radii[0] ** (k + m) * radii[1] ** (i + j - k - m)
            * moment(k, m) * moment(i - k, j - m) for k, m in terms
        )  # fmt: skip
        size = np.sum(weight * np.abs(total) ** i * np.abs(across) ** j)
        assert abs(np.sum(weight * total**i * across**j) - exact) < 1e-7 * size


@pytest.mark.parametrize("radii", RADII)
def test_rules_have_the_stated_pairs_within_both_discs(radii: tuple[float, float]):
    """Of very unequal discs a point may be outside by a thousandth of the radius."""
    rules = pair_rules(radii)
    assert [a.shape[1] for a in rules] == list(COUNTS) and len(FINENESS) == len(COUNTS)
    for x_a, y_a, x_b, y_b, weight in rules:
        assert max(np.hypot(x_a, y_a).max(), np.hypot(x_b, y_b).max()) < 1.001
        assert weight.sum() == pytest.approx(1.0, abs=1e-12)
