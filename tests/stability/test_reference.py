"""The reference's slopes, at forty digits."""

import numpy as np
import pytest
from mpmath import mp

from gonio.stability.reference import DIGITS, Reference


def test_infinite_slopes_inside_of_a_domain_are_seen():
    """(θ − θ0)^k has a cusp at θ = θ0 for k < 1."""
    wi, wo = (0.0, 0.0, 1.0), (0.6, 0.0, 0.8)
    words = "alpha=0.1, p=0.7, kappa=5, f0=0.04, f1=0, lam=3, c=0.1, theta_0=0"
    with mp.workdps(DIGITS):
        for k, infinite in ((0.5, True), (2, False)):
            reference = Reference(f"sgd({words}, k={k})", np.float64)
            assert reference.infinite("theta_0", reference.inputs(wi, wo)) == infinite


def test_a_slope_at_forty_digits():
    reference = Reference("phong(n=3)", np.float64)
    wi, wo = (0.0, 0.6, 0.8), (0.0, 0.0, 1.0)
    with mp.workdps(DIGITS):
        n, c = mp.mpf(3), mp.mpf(0.8)
        exact = c**n / (2 * mp.pi) * (1 + (n + 2) * mp.log(c))
        assert float(reference.slope("n", reference.inputs(wi, wo))) == pytest.approx(float(exact), rel=1e-12)


def test_a_slope_beside_a_jump():
    """A lobe of exponent 0 jumps at its edge, here 1e-15 away: steps of its weights fall across."""
    wi, wo = (0.6, 0.0, 0.8), (0.8, 0.0, 0.6 + 1e-15)
    reference = Reference("lafortune(c_x=-1, c_y=-1, c_z=1, n=0)", np.float64)
    with mp.workdps(DIGITS):
        inputs = reference.inputs(wi, wo)
        assert abs(reference.slope("c_x", inputs)) > 1e10 and reference.slope_beside("c_x", inputs) == 0


def test_the_slope_of_a_white_half_space_is_infinite_even_at_grazing():
    wi = wo = (0.6, 0.8, 1e-15)
    with mp.workdps(DIGITS):
        reference = Reference("chandrasekhar(w=1)", np.float64)
        assert reference.infinite("w", reference.inputs(wi, wo))
