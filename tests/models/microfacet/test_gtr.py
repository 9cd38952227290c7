"""The generalised Trowbridge–Reitz law: normalisation, seams at γ = 1 and α = 1, GGX as a member."""

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from gonio.models.microfacet.ggx import GGX
from gonio.models.microfacet.gtr import GTR, gtr_d
from support.directions import random_pairs, slope_grid


@pytest.mark.parametrize("alpha", [1e-3, 0.2, 1.0])
def test_projected_area_of_the_facets_is_one(alpha):
    """In the plane of normals: ∫ D(μ) 2πμ dμ with 1 + (α² − 1)μ² as the variable, in logarithmic steps."""
    x, w = np.polynomial.legendre.leggauss(200)
    log_x = np.log(alpha**2) * (1 - x) / 2 if alpha < 1 else None
    for gamma in (0.5, 1.0, 1.5, 5.0):
        if alpha < 1:
            value = np.exp(log_x)
            cos2 = (1 - value) / (1 - alpha**2)
            sin2 = (value - alpha**2) / (1 - alpha**2)
            measure = -np.log(alpha**2) / 2 * w * value * np.pi / (1 - alpha**2)
        else:
            cos2, measure = (x + 1) / 2, np.pi * w / 2
            sin2 = 1 - cos2
        d = gtr_d(Direction(jnp.sqrt(sin2), jnp.zeros_like(sin2), jnp.sqrt(cos2)), alpha, gamma)
        assert np.sum(np.asarray(d) * measure) == pytest.approx(1, abs=1e-11)


def test_gamma_two_is_normalised_over_slopes_too():
    m, area = slope_grid(0.3, 0.3)
    assert np.sum(gtr_d(m, 0.3, 2.0) * m.z * area) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("gamma", [0.5, 0.999999, 1.0, 1.0000001, 1.5, 5.0])
def test_density_is_burleys(gamma):
    """(γ−1)(α²−1)/(π(1 − α^(2−2γ)))/(1 + (α²−1)cos²θ)^γ [Burley 2012, appendix B], its logarithm at γ = 1."""
    for alpha in (1e-4, 0.1, 0.999999):
        for tilt in (0.0, alpha, 0.4, 1.5):
            h = Direction(np.sin(tilt), 0.0, np.cos(tilt))
            with mpmath.workdps(40):
                a2, g = mpmath.mpf(alpha) ** 2, mpmath.mpf(gamma)
                sin2 = mpmath.mpf(float(h.x)) ** 2
                factor = (g - 1) / (1 - a2 ** (1 - g)) if gamma != 1 else 1 / mpmath.log(a2)
                expected = factor * (a2 - 1) / (mpmath.pi * (1 + (a2 - 1) * (1 - sin2)) ** g)
            assert float(gtr_d(h, alpha, gamma)) == pytest.approx(float(expected), rel=2e-14 * (1 + 10 * gamma))


def test_both_seams_are_closed():
    """γ = 1 and α = 1 take the limits of their neighbours, derivatives included."""
    h = Direction(0.6, 0.0, 0.8)
    assert float(gtr_d(h, 1.0, 3.0)) == pytest.approx(1 / np.pi, rel=1e-15)
    for gamma in (0.7, 1.0, 3.0):
        assert float(gtr_d(h, 1.0 - 1e-7, gamma)) == pytest.approx(1 / np.pi, rel=2e-6)


def test_gamma_two_is_ggx():
    wi, wo = random_pairs()
    for alpha in (1e-4, 0.1, 1.0):
        f = evaluate(GTR(alpha=alpha, gamma=2.0, eta=1.5), wi, wo)
        np.testing.assert_allclose(f, evaluate(GGX(alpha=alpha, eta=1.5), wi, wo), rtol=2e-13)
