"""Oren and Nayar's model against an independent implementation, the liars' table and its own limits."""

import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.diffuse.oren_nayar import OrenNayar
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical
from support import helpers
from support.directions import random_angles


def test_qualitative_form_against_an_independent_implementation():
    """OrenNayar there is the qualitative form, its roughness our sigma: no difference of definition."""
    data = np.load(helpers.shared("oracle", "models_double.npz"), allow_pickle=False)
    wi, wo = (Direction(*data[w].T) for w in ("wi", "wo"))
    for sigma in (0.05, 0.1, 0.2, 0.5, 0.9):
        at = list(data["model"]).index(f"OrenNayar(albedo=[0.8,0.5,0.1], roughness={sigma})")
        found = evaluate(OrenNayar([0.8, 0.5, 0.1], sigma, form="qualitative"), wi, wo)
        np.testing.assert_allclose(found, data["f"][at], rtol=1e-13, atol=0)


def test_full_form_as_printed():
    theta, phi, wi, wo = random_angles(400)
    rho, s2 = 0.7, 0.5**2
    alpha, beta, cos_phi = theta.max(0), theta.min(0), np.cos(phi[0] - phi[1])
    c1 = 1 - 0.5 * s2 / (s2 + 0.33)
    c2 = 0.45 * s2 / (s2 + 0.09) * (np.sin(alpha) - np.where(cos_phi < 0, (2 * beta / np.pi) ** 3, 0))
    c3 = 0.125 * s2 / (s2 + 0.09) * (4 * alpha * beta / np.pi**2) ** 2
    once = c1 + cos_phi * c2 * np.tan(beta) + (1 - abs(cos_phi)) * c3 * np.tan((alpha + beta) / 2)
    twice = 0.17 * s2 / (s2 + 0.13) * (1 - cos_phi * (2 * beta / np.pi) ** 2)
    np.testing.assert_allclose(evaluate(OrenNayar(rho, 0.5), wi, wo), (rho * once + rho**2 * twice) / np.pi, rtol=2e-14)


def test_a_smooth_surface_is_lambert():
    *_, wi, wo = random_angles(50)
    for form in ("full", "qualitative"):
        np.testing.assert_allclose(evaluate(OrenNayar(0.6, 0.0, form=form), wi, wo), 0.6 / np.pi, rtol=1e-15)


def test_albedos_where_it_gains():
    mu = np.array([0.1, 0.02])
    full = directional_albedo(OrenNayar(1.0, 0.3), np.arccos(mu))
    np.testing.assert_allclose(full.value, [1.027, 1.043], atol=6e-4)
    assert np.all(full.bound < 1e-9)


@pytest.mark.parametrize("sigma", [0.3, 1.2])
def test_albedo_of_the_qualitative_form(sigma):
    """A + (B/π)(S(θ − Sμ) + (2/3)(S/μ)(1 − S³)) S = sinθ, half of the azimuths: ∫ max(0, cosφ) dφ = 2."""
    s2, mu = sigma**2, np.array([1.0, 0.7, 0.2, 1e-3])
    theta, s = np.arccos(mu), np.sqrt(1 - mu**2)
    g = s * (theta - s * mu) + 2 / 3 * (s / mu) * (1 - s**3)
    expected = 1 - 0.5 * s2 / (s2 + 0.33) + 0.45 * s2 / (s2 + 0.09) * g / np.pi
    found = directional_albedo(OrenNayar(1.0, sigma, form="qualitative"), theta, 0.7)
    np.testing.assert_allclose(found.value, expected, atol=1e-11)


def test_below_zero_for_dark_rough_facets():
    opposite = from_spherical(1.5707, 0.0), from_spherical(1.5707, np.pi)
    assert evaluate(OrenNayar(1e-6, 0.65), *opposite) > 0
    assert evaluate(OrenNayar(1.0, np.pi / 2), *opposite) * np.pi == pytest.approx(0.053, abs=1e-3)
    assert evaluate(OrenNayar(1e-6, np.pi / 2), *opposite) * np.pi / 1e-6 == pytest.approx(-0.27, abs=5e-3)
