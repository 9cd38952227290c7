"""The kernels of the MODIS albedo product: the printed formulas, the published integrals, the end of the shadows."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo, hemispherical_albedo
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical
from gonio.models.volume_scatter.ross_li import RossLi, _overlap

KERNELS = RossLi([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])


def test_kernels_as_printed():
    rng = np.random.default_rng(2)
    theta, phi = rng.uniform(0, 1.5, (2, 400)), rng.uniform(0, 2 * np.pi, (2, 400))
    (mu_i, mu_o), (tan_i, tan_o), azimuth = np.cos(theta), np.tan(theta), phi[0] - phi[1]
    cos_xi = mu_i * mu_o + np.sin(theta[0]) * np.sin(theta[1]) * np.cos(azimuth)
    xi = np.arccos(cos_xi)
    volumetric = ((np.pi / 2 - xi) * cos_xi + np.sin(xi)) / (mu_i + mu_o) - np.pi / 4
    distance2 = tan_i**2 + tan_o**2 - 2 * tan_i * tan_o * np.cos(azimuth)
    secants = 1 / mu_i + 1 / mu_o
    t = np.arccos(np.minimum(2 * np.sqrt(distance2 + (tan_i * tan_o * np.sin(azimuth)) ** 2) / secants, 1))
    overlap = (t - np.sin(t) * np.cos(t)) * secants / np.pi
    geometric = overlap - secants + (1 + cos_xi) / (2 * mu_i * mu_o)
    found = np.asarray(evaluate(KERNELS, *(from_spherical(*a) for a in zip(theta, phi, strict=True)))) * np.pi
    np.testing.assert_allclose(found[:, 0], 1.0, rtol=1e-15)
    np.testing.assert_allclose(found[:, 1], volumetric, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found[:, 2], geometric, rtol=1e-12, atol=1e-12)
    assert np.sum(t == 0) > 50 and np.sum(t > 0) > 50


def test_both_kernels_are_0_at_the_zenith():
    zenith = from_spherical(0.0, 0.0)
    np.testing.assert_allclose(evaluate(KERNELS, zenith, zenith) * np.pi, [1, 0, 0], atol=1e-15)


def test_white_sky_integrals_of_the_albedo_product():
    """1, 0.189184 and −1.377622 in the user's guide of MCD43 [Lucht 2000]: theirs are integrated to some 3e-5."""
    found = hemispherical_albedo(KERNELS, 1e-6)
    np.testing.assert_allclose(found.value, [1.0, 0.189184, -1.377622], atol=4e-5)
    assert np.all(found.bound < 1e-6)


def test_the_map_meets_the_end_of_the_shadows():
    """K_geo at normal incidence: the shadows part at tan(θo/2) = ½, and both sides are integrated by SciPy."""
    quad = pytest.importorskip("scipy.integrate").quad

    def geometric(theta):
        mu = np.cos(theta)
        cos_t = min(2 * np.sin(theta) / (1 + mu), 1)
        t = np.arccos(cos_t)
        value = (1 + 1 / mu) * ((t - np.sin(t) * cos_t) / np.pi - 1) + (1 + mu) / (2 * mu)
        return 2 * value * mu * np.sin(theta)

    edge = 2 * np.arctan(0.5)
    expected = sum(quad(geometric, *ends, epsabs=1e-13)[0] for ends in ((0, edge), (edge, np.pi / 2)))
    found = directional_albedo(KERNELS, np.arccos([1.0, 0.5, 0.05]), 0.4)
    assert found.value[0, 2] == pytest.approx(expected, abs=1e-11)
    assert np.all(found.bound < 1e-9)


def test_slope_of_the_overlap():
    c = jnp.asarray([0.0, 0.3, 0.9, 0.9999])
    step = 1e-6
    slope = jax.vmap(jax.grad(_overlap))(c)
    np.testing.assert_allclose(slope, (_overlap(c + step) - _overlap(c - step)) / (2 * step), rtol=1e-4)
    assert np.all(np.asarray(jax.vmap(jax.grad(_overlap))(jnp.asarray([1.0, 1.7]))) == 0)
