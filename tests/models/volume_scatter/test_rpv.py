"""Rahman, Pinty and Verstraete's model: the printed formula, its hot spot, its limits."""

import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical
from gonio.models.volume_scatter.rpv import RPV
from support.directions import random_angles


@pytest.mark.parametrize(("k", "asymmetry"), [(0.6, -0.2), (1.4, 0.3)])
def test_as_printed(k, asymmetry):
    rho0, rho_c = 0.2, 0.1
    theta, phi, wi, wo = random_angles(300)
    (mu_i, mu_o), (tan_i, tan_o), cos_phi = np.cos(theta), np.tan(theta), np.cos(phi[0] - phi[1])
    cos_g = mu_i * mu_o + np.sin(theta[0]) * np.sin(theta[1]) * cos_phi
    phase = (1 - asymmetry**2) / (1 + 2 * asymmetry * cos_g + asymmetry**2) ** 1.5
    distance = np.sqrt(tan_i**2 + tan_o**2 - 2 * tan_i * tan_o * cos_phi)
    expected = rho0 * (mu_i * mu_o * (mu_i + mu_o)) ** (k - 1) * phase * (1 + (1 - rho_c) / (1 + distance)) / np.pi
    np.testing.assert_allclose(evaluate(RPV(rho0, k, asymmetry, rho_c), wi, wo), expected, rtol=1e-12)


def test_lambert_is_its_simplest_case():
    *_, wi, wo = random_angles(50)
    np.testing.assert_allclose(evaluate(RPV(0.3, 1.0, 0.0, 1.0), wi, wo), 0.3 / np.pi, rtol=1e-15)


def test_the_hot_spot_is_a_cone_of_height_2_less_rho_c():
    """Beside it 1/(1 + G) falls with G = tan θo − tan θi, however near: no digit of the difference is lost."""
    theta, steps = 0.8, np.array([0.0, 1e-12, 1e-9, 1e-5])
    wi = from_spherical(jnp.full(4, theta), jnp.full(4, 0.3))
    wo = from_spherical(jnp.asarray(theta + steps), jnp.full(4, 0.3))
    ratio = np.asarray(evaluate(RPV(0.3, 1.0, 0.0, 0.2), wi, wo)) * np.pi / 0.3
    assert ratio[0] == pytest.approx(1.8, rel=1e-15)
    cone = 0.8 * steps / np.cos(theta) ** 2
    np.testing.assert_allclose(1.8 - ratio[1:3], cone[1:3], rtol=3e-4)
    np.testing.assert_allclose(1.8 - ratio[3], cone[3], rtol=1e-4)


def test_albedo_of_the_bowl_alone():
    """At normal incidence with Θ = 0, ρc = 1: 2 ρ0 ∫ μᵏ (1 + μ)^(k−1) dμ, by Gauss–Jacobi."""
    roots_jacobi = pytest.importorskip("scipy.special").roots_jacobi
    k = 0.35
    x, weight = roots_jacobi(40, 0.0, k)
    mu = (x + 1) / 2
    expected = 2 * 0.2 * np.sum(weight * (1 + mu) ** (k - 1)) / 2 ** (k + 1)
    found = directional_albedo(RPV(0.2, k, 0.0, 1.0), 0.0)
    assert found.value == pytest.approx(expected, rel=1e-11)


def test_the_hot_spot_is_resolved():
    found = directional_albedo(RPV(0.2, 0.6, -0.1, 0.1), np.arccos([1.0, 0.5, 0.1, 0.02]), 0.4)
    assert np.all(found.bound < 1e-9)
