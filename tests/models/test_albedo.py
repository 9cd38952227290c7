"""Hemisphere integrals: closed forms, other people's tables, and bounds that hold."""

import csv

import numpy as np
import pytest
from scipy.integrate import quad

from gonio.models.albedo import directional_albedo, hemispherical_albedo
from gonio.models.diffuse.lambert import Lambert
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.microfacet.ggx import GGX
from gonio.stability.problems import ALBEDOS
from support import helpers

THETA = np.radians([0, 30, 60, 80, 89])


@pytest.mark.parametrize("problem", ALBEDOS, ids=lambda problem: problem.name)
def test_closed_forms(problem):
    brdf, mu = build(problem.expression), np.cos(THETA)
    estimate = directional_albedo(brdf, THETA, tolerance=1e-9)
    assert np.all(np.abs(estimate.value - problem.exact(mu)) <= estimate.bound + brdf.accuracy + 1e-13)
    assert "tabled" in problem.tags or np.all(estimate.bound <= 1e-9)
    average = hemispherical_albedo(brdf)
    assert abs(float(average.value) - problem.average) <= float(average.bound) + brdf.accuracy + 1e-13


@pytest.mark.parametrize("alpha", [0.5, 0.25, 0.1, 0.01])
def test_normal_incidence_is_its_integral(alpha):
    def integrand(t):
        return alpha**2 / (alpha**2 + t) ** 2 * 2 * (1 - t) / ((1 - t) + np.sqrt((1 - t) ** 2 + 4 * alpha**2 * t))

    expected = quad(integrand, 0, 1, epsabs=1e-13, epsrel=1e-13, points=[alpha**2, 10 * alpha**2])[0]
    e = directional_albedo(GGX(alpha=alpha), 0.0, tolerance=1e-11)
    assert float(e.value) == pytest.approx(expected, abs=1e-10)


def test_average_of_an_anisotropic_lobe_is_that_of_its_isotropic_limit():
    anisotropic = hemispherical_albedo(GGX(alpha_x=0.5, alpha_y=0.5 + 1e-9), tolerance=1e-6)
    assert float(anisotropic.value) == pytest.approx(float(hemispherical_albedo(GGX(alpha=0.5), 1e-6).value), abs=1e-6)


def test_albedo_table_of_another_implementation():
    with helpers.shared("oracle", "ggx_F1_albedo_float64.csv").open() as file:
        rows = [{k: float(v) for k, v in r.items()} for r in csv.DictReader(file)]
    for smith, column in (("separable", "albedo_separable_smith"), ("correlated", "albedo_height_correlated")):
        for alpha in sorted({r["alpha"] for r in rows}):
            mine = [r for r in rows if r["alpha"] == alpha]
            e = directional_albedo(
                GGX(alpha=alpha, smith=smith), np.radians([r["theta_i_deg"] for r in mine]), tolerance=1e-9
            )
            np.testing.assert_allclose(e.value, [r[column] for r in mine], atol=1e-8)


@pytest.mark.parametrize("kind", [GGX, Beckmann])
def test_bounds_hold_at_every_width_and_incidence(kind):
    """Against the same integral at the last order, whose own bound is far below the one on trial."""
    theta = np.radians([0, 20, 45, 70, 85, 88, 89.5, 89.9])
    for alpha in (1e-3, 0.02, 0.2, 0.7):
        model = kind(alpha=alpha, eta=1.5)
        fine = directional_albedo(model, theta, tolerance=1e-13)
        assert fine.bound.max() < 1e-8
        for tolerance in (1e-2, 1e-4, 1e-6):
            e = directional_albedo(model, theta, tolerance=tolerance)
            assert np.all(np.abs(e.value - fine.value) <= e.bound + fine.bound)
            assert e.bound.max() <= tolerance


def test_a_narrow_lobe_costs_what_a_wide_one_does():
    needed = [directional_albedo(GGX(alpha=a), THETA[:3], tolerance=1e-6).evaluations for a in (1e-3, 0.03, 1.0)]
    assert max(needed) <= 16 * min(needed)  # two doublings of the order; by angles it would be 10⁶ times


def test_sums_go_term_by_term_and_channels_apart():
    brdf = build("lambert(rho=[0.1, 0.2, 0.4]) + [1, 0.8, 0.6] * ggx(alpha=0.01)")
    lobe = directional_albedo(GGX(alpha=0.01), THETA, tolerance=1e-10).value
    e = directional_albedo(brdf, THETA, tolerance=1e-9)
    expected = np.array([0.1, 0.2, 0.4]) + lobe[:, None] * np.array([1, 0.8, 0.6])
    np.testing.assert_allclose(e.value, expected, atol=1e-9)


def test_kink_of_the_rational_masking_shows_in_the_bound():
    """Walter's rational fit has a kink, so its integral converges slowly: the bound must say that, and hold."""
    e = directional_albedo(Beckmann(alpha=0.5, smith="walter"), THETA, tolerance=1e-4)
    fine = directional_albedo(Beckmann(alpha=0.5, smith="walter"), THETA, tolerance=1e-15)
    assert np.all(np.abs(e.value - fine.value) <= e.bound + fine.bound) and fine.bound.max() > 1e-12


def test_lambert_is_its_albedo():
    np.testing.assert_allclose(directional_albedo(Lambert(rho=0.37), THETA).value, 0.37, rtol=1e-13)


def test_many_incidences_of_terms_that_need_different_rules_are_those_of_each():
    brdf, theta = build("lambert(rho=0.3) + 0.2 * ggx(alpha=0.3) + 0.1 * ggx(alpha=0.08)"), np.radians(range(0, 86, 5))
    together = directional_albedo(brdf, theta, 0.0, 1e-7).value
    apart = [directional_albedo(brdf, theta[k : k + 9], 0.0, 1e-7).value for k in (0, 9)]
    np.testing.assert_allclose(together, np.concatenate(apart), atol=2e-7)


@pytest.mark.thorough
def test_bounds_hold_where_light_is_reflected_totally():
    """∫ over direction cosines in polar coordinates, which ends at the kink, sinθ = η, and runs to it as a square."""
    eta = 0.01
    brdf = build(f"rayleigh_rice(wavelength=0.55, eta={eta}, a=0.01, b=100, c=2.5)")
    x, w = np.polynomial.legendre.leggauss(80)
    x, w, true = 0.5 * (1 + x), 0.5 * w, 0.0
    up = Direction(*(np.zeros(160), np.zeros(160), np.ones(160)))
    for low, high in ((0.0, eta), (eta, 1.0)):
        # From both ends as squares: the root at the kink, and the cosine at the rim, are smooth then.
        half = 0.5 * (high - low)
        rho = np.concatenate([low + half * x**2, high - half * x**2])
        weight = np.tile(2 * half * x * w, 2)
        wo = Direction(rho, np.zeros(160), np.sqrt(1 - rho * rho))
        true += float(np.sum(evaluate(brdf, up, wo) * weight * 2 * np.pi * rho))
    e = directional_albedo(brdf, 0.0, tolerance=2.5e-7)
    assert abs(float(e.value) - true) <= float(e.bound)
