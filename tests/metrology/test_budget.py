"""The arithmetic of the GUM, against its own worked example."""

import math

import numpy as np
import pytest

from gonio.metrology.budget import Budget, Contribution, joined


def budget(*rows, missing=None):
    return Budget(list(rows), missing or {}, np.zeros(rows[0].values.size, bool))


def test_the_example_of_annex_g():
    # JCGM 100:2008, G.4.1: y = b x1 x2 x3 with relative uncertainties of 0.25, 0.57 and 0.82 % from 10, 5, 15 readings.
    of = [(0.25, 9), (0.57, 4), (0.82, 14)]
    b = budget(*(Contribution(f"x{k}", "", False, np.array([u]), dof=dof) for k, (u, dof) in enumerate(of)))
    assert b.standard == pytest.approx(1.03, abs=0.005) and b.dof == pytest.approx(19.0, abs=0.05)
    # Student's t of 95.45 % and 18 degrees of freedom (19.0 is truncated), table G.2: 2.15; of 19: 2.14.
    assert b.factor == pytest.approx(2.15, abs=0.011) and b.expanded == pytest.approx(2 * b.standard)


def test_without_freedom_lost_k_is_2_and_shared_errors_correlate():
    shared, alone = np.array([0.3, -0.4]), np.array([0.4, 0.3])
    b = budget(Contribution("gain", "", True, shared, 0.01), Contribution("counting", "", False, alone))
    assert b.standard == pytest.approx([0.5, 0.5]) and np.isinf(b.dof).all() and (b.factor == 2).all()
    assert b.systematic == pytest.approx([0.3, 0.4])
    assert b.covariance() == pytest.approx(np.array([[0.25, -0.12], [-0.12, 0.25]]))
    assert b.contributions[0].sensitivities == pytest.approx([30, -40])
    assert b.contributions[1].sensitivities is None


def test_joining_keeps_one_input_one_and_what_is_not_known():
    a = budget(Contribution("gain", "", True, np.array([0.3]), 0.01), missing={"tilt_x": "why"})
    b = budget(
        Contribution("gain", "", True, np.array([0.1, 0.2]), 0.01), Contribution("fit", "", False, np.array([1.0, 2.0]))
    )
    both = joined(a, b)
    assert [c.name for c in both.contributions] == ["gain", "fit"] and both.missing == {"tilt_x": "why"}
    assert both.standard == pytest.approx([0.3, math.hypot(0.1, 1), math.hypot(0.2, 2)])
