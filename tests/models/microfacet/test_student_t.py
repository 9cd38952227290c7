"""Student's slopes: masking against incomplete beta functions, GGX and Beckmann as members of the family."""

import jax
import mpmath
import numpy as np
import pytest

from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.microfacet.ggx import GGX
from gonio.models.microfacet.student_t import STD, student_d, student_shadowing
from support.directions import random_pairs, slope_grid
from support.marks import thorough

shadowing = jax.jit(student_shadowing)


def exact_lambda(slope, gamma):
    """Λ at cotθ/α = slope, by the incomplete beta function, in mpmath's numbers."""
    a, c = mpmath.mpf(slope), mpmath.mpf(gamma) - 1
    half = mpmath.mpf(1) / 2
    peak = mpmath.gamma(c + half) / (mpmath.sqrt(mpmath.pi * c) * mpmath.gamma(c))
    beyond = mpmath.betainc(c, half, 0, c / (c + a * a), regularized=True) / 2
    return peak * c / (2 * c - 1) * (1 + a * a / c) ** (half - c) / a - beyond


@pytest.mark.parametrize("gamma", [1.6, 1.75, 2.0, 3.0, 7.0, 15.0, 40.0])
def test_masking_is_that_of_the_slopes(gamma):
    """1 + Λ to 1e-12 from near normal to grazing incidence [Ribardière et al. 2017, eq. 13, without its fits]."""
    for alpha in (1.0, 0.1):
        for theta in (0.01, 0.3, 0.8, 1.2, 1.5, 1.57, 1.5707):
            w = Direction(np.sin(theta), 0.0, np.cos(theta))
            excess, masked = (float(v) for v in shadowing(w, alpha, alpha, gamma))
            expected = float(exact_lambda(w.z / (alpha * w.x), gamma))
            assert masked == pytest.approx(w.z * (1 + expected), rel=1e-12)
            assert excess == pytest.approx(w.z * expected, abs=1e-12 * masked)


@pytest.mark.parametrize("widths", [(0.001, 0.001), (0.5, 0.1), (1.0, 1.0)])
def test_projected_area_of_the_facets_is_one(widths):
    m, area = slope_grid(*widths)
    for gamma in (2.5, 4.0, 40.0):
        assert np.sum(student_d(m, *widths, gamma) * m.z * area) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("smith", ["separable", *thorough("correlated")])
def test_gamma_two_is_ggx(smith):
    wi, wo = random_pairs()
    for widths in ({"alpha": 0.001}, {"alpha": 1.0}, {"alpha_x": 0.4, "alpha_y": 0.01}):
        f = evaluate(STD(gamma=2.0, **widths, f0=0.04, smith=smith), wi, wo)
        np.testing.assert_allclose(f, evaluate(GGX(**widths, f0=0.04, smith=smith), wi, wo), rtol=1e-12)


def test_many_gamma_is_beckmann():
    wi, wo = random_pairs()
    f, limit = (evaluate(m, wi, wo) for m in (STD(gamma=1e7, alpha=0.6), Beckmann(alpha=0.6)))
    seen = limit > 1e-20
    np.testing.assert_allclose(np.asarray(f)[seen], np.asarray(limit)[seen], rtol=2e-4)
