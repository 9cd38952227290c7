"""Hapke's regolith: the printed formula, its isotropic limit, its H functions, the mean of P, its map."""

import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical
from gonio.models.geometry.phase_angle import henyey_greenstein
from gonio.models.volume_scatter.half_space import Chandrasekhar
from gonio.models.volume_scatter.hapke import Hapke
from support.directions import random_angles


def h_as_printed(which, mu, w):
    gamma = np.sqrt(1 - w)
    if which == "1981":
        return (1 + 2 * mu) / (1 + 2 * mu * gamma)
    r0 = (1 - gamma) / (1 + gamma)
    return 1 / (1 - w * mu * (r0 + (1 - 2 * r0 * mu) / 2 * np.log((1 + mu) / mu)))


@pytest.mark.parametrize("which", ["1981", "2002"])
def test_as_printed(which):
    w, b, c, b0, h = 0.8, 0.4, 0.3, 0.9, 0.05
    theta, phi, wi, wo = random_angles(300)
    mu_i, mu_o = np.cos(theta)
    cos_g = mu_i * mu_o + np.sin(theta[0]) * np.sin(theta[1]) * np.cos(phi[0] - phi[1])
    surge = b0 / (1 + np.tan(np.arccos(cos_g) / 2) / h)
    back, forward = ((1 - b**2) / (1 - 2 * s * b * cos_g + b**2) ** 1.5 for s in (1, -1))
    phase = (1 + c) / 2 * back + (1 - c) / 2 * forward
    twice = h_as_printed(which, mu_i, w) * h_as_printed(which, mu_o, w) - 1
    expected = w / (4 * np.pi * (mu_i + mu_o)) * ((1 + surge) * phase + twice)
    found = evaluate(Hapke(w, b, c, b0, h, h_function=which), wi, wo)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_isotropic_scattering_is_chandrasekhar():
    *_, wi, wo = random_angles(300)
    w = [0.4, 0.99, 1.0]
    found = evaluate(Hapke(w, 0.0, 0.0, 0.0, 0.1, h_function="exact"), wi, wo)
    np.testing.assert_allclose(found, evaluate(Chandrasekhar(w), wi, wo), rtol=1e-14)


def test_how_far_the_approximations_of_h_are():
    """At most 4 % in 1981 and 1 % in 2002 [Hapke 2002]: the light scattered more than once is H² − 1 for μi = μo."""
    theta = np.linspace(0, np.pi / 2 - 1e-3, 60)
    w = [0.2, 0.5, 0.8, 0.95, 1.0]
    same = from_spherical(jnp.asarray(theta), jnp.zeros(60))

    def h(which):
        f = np.asarray(evaluate(Hapke(w, 0.0, 0.0, 0.0, 0.1, h_function=which), same, same))
        return np.sqrt(f * 8 * np.pi * np.cos(theta)[:, None] / w)

    exact = h("exact")
    assert 0.02 < np.max(abs(h("1981") / exact - 1)) < 0.041
    assert 0.005 < np.max(abs(h("2002") / exact - 1)) < 0.011


@pytest.mark.parametrize("b", [0.0, 0.5, 0.99])
def test_phase_function_has_the_mean_1(b):
    # dΩ/4π = d(chord²)/4; an even spread in log((1−b)² + b chord²) resolves the peak.
    x, weight = np.polynomial.legendre.leggauss(60)
    low, high = 2 * np.log(1 - b), 2 * np.log(1 + b)
    d = np.exp(low + (high - low) * (x + 1) / 2)
    chord2 = (d - (1 - b) ** 2) / b if b else 2 * (x + 1)
    rate = d * (high - low) / 2 / b if b else 2.0
    value = henyey_greenstein(jnp.sqrt(chord2), jnp.asarray(b))
    assert np.sum(weight * rate * value) / 4 == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize("h", [1e-4, 0.1])
def test_a_surge_at_normal_incidence(h):
    """There g = θo, and the integral over azimuth is 2π: SciPy over t = tan(θo/2)."""
    quad = pytest.importorskip("scipy.integrate").quad
    w = 0.7

    def integrand(log_t):
        t = np.exp(log_t)
        mu, sin_t = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
        return w / (2 * (1 + mu)) / (1 + t / h) * mu * sin_t * 2 * t / (1 + t * t)

    surge = quad(integrand, -40, 0, epsabs=1e-15, epsrel=1e-13, limit=400)[0]
    found = directional_albedo(Hapke(w, 0.0, 0.0, [0.0, 1.0], h), 0.0)
    assert found.value[1] - found.value[0] == pytest.approx(surge, abs=1e-13)
    assert np.all(found.bound < 1e-9)


def test_a_narrow_surge_is_resolved_everywhere():
    found = directional_albedo(Hapke(0.9, 0.3, 0.3, 1.0, 1e-4), np.arccos([0.9, 0.5, 0.1, 0.01]), 0.4)
    assert np.all(found.bound < 1e-9)
