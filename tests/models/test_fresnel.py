"""Fresnel reflectance against complex arithmetic and the textbook's special angles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.fresnel import fresnel, fresnel_conductor, fresnel_dielectric, fresnel_schlick1994

COS = np.r_[0.0, np.geomspace(1e-6, 1, 60)]


def textbook(cos_d, index):
    """(R_s, R_p) by complex numbers in extended precision."""
    c = np.asarray(cos_d, np.clongdouble)
    n = np.clongdouble(index)
    t = np.sqrt(n * n - (1 - c) * (1 + c))
    r_s, r_p = (c - t) / (c + t), (n * n * c - t) / (n * n * c + t)
    return np.abs(r_s) ** 2, np.abs(r_p) ** 2


@pytest.mark.parametrize("index", [1.33, 1.5, 2.4, 0.7, 1 + 1e-6])
def test_dielectric(index):
    expected = sum(textbook(COS[1:], index)) / 2
    np.testing.assert_allclose(
        fresnel_dielectric(COS[1:], index), expected.astype(float), rtol=2e-9 if index < 1.01 else 1e-13
    )


@pytest.mark.parametrize("index", [0.18 + 3.42j, 1.37 + 1.77j, 1.44 + 7.5j, 1.5 + 1e-9j, 0.05 + 20j])
def test_conductor(index):
    expected = sum(textbook(COS[1:], index)) / 2
    found = fresnel_conductor(COS[1:], index.real, index.imag)
    np.testing.assert_allclose(found, expected.astype(float), rtol=1e-12)


def test_conductor_without_absorption_is_a_dielectric():
    for index in (1.5, 0.7):
        np.testing.assert_allclose(fresnel_conductor(COS, index, 0.0), fresnel_dielectric(COS, index), rtol=1e-12)


def test_special_angles():
    n = 1.5
    assert float(fresnel_dielectric(1.0, n)) == pytest.approx(((n - 1) / (n + 1)) ** 2, rel=1e-15)
    assert float(fresnel_dielectric(0.0, n)) == pytest.approx(1, rel=4e-15)
    assert float(fresnel_dielectric(0.1, 0.7)) == 1.0  # total internal reflection
    brewster = np.cos(np.arctan(n))
    r_s, r_p = textbook(brewster, n)
    assert r_p < 1e-30 and float(fresnel_dielectric(brewster, n)) == pytest.approx(float(r_s) / 2, rel=1e-14)
    for eta, k in ((0.2, 3.0), (1.4, 7.0), (2.5, 0.1)):
        r_s = float(textbook(np.sqrt(0.5), eta + 1j * k)[0])  # R_p(45°) = R_s(45°)²
        assert float(fresnel_conductor(np.sqrt(0.5), eta, k)) == pytest.approx((r_s + r_s**2) / 2, rel=1e-13)
        assert float(fresnel_conductor(1.0, eta, k)) == pytest.approx(
            ((eta - 1) ** 2 + k * k) / ((eta + 1) ** 2 + k * k)
        )
        assert float(fresnel_conductor(0.0, eta, k)) == pytest.approx(1.0)


def test_index_near_one_in_single_precision():
    """The textbook's quotients are 9 % off here: η − 1 must be carried."""
    n = np.float32(1) + np.float32(2) ** -20
    for c in (0.2, 0.7, 1.0):
        found = fresnel_dielectric(jnp.float32(c), jnp.float32(n))
        r_s, r_p = textbook(float(np.float32(c)), float(n))
        assert found.dtype == jnp.float32
        assert float(found) == pytest.approx(float(r_s + r_p) / 2, rel=5e-6)


def test_schlick_average_is_its_closed_form():
    x, w = np.polynomial.legendre.leggauss(16)
    mu = (x + 1) / 2
    average = np.sum(w * mu * np.asarray(fresnel_schlick1994(mu, 0.04)))
    assert average == pytest.approx(0.04 + 0.96 / 21, rel=1e-14)


def test_gradients_are_finite_on_the_edges_of_the_domain():
    cosines, indices = (0.0, 1e-12, np.sqrt(1 - 0.49), 1.0), (0.7, 1.0, 1.5)
    for function, axes in (
        (fresnel_dielectric, (cosines, indices)),
        (fresnel_conductor, (cosines, indices, (0.0, 3.0))),
    ):
        edges = [jnp.ravel(a) for a in jnp.meshgrid(*map(jnp.asarray, axes))]
        slopes = jax.jit(jax.vmap(jax.grad(function, argnums=tuple(range(len(axes))))))(*edges)
        assert np.all(np.isfinite(slopes))


def test_which_parameters_mean_which_reflectance():
    assert float(fresnel(jnp.asarray(0.3), None, None, None)) == 1.0
    assert float(fresnel(jnp.asarray(1.0), 0.04, None, None)) == pytest.approx(0.04)
    assert float(fresnel(jnp.asarray(1.0), None, 1.5, None)) == pytest.approx(0.04)
    assert float(fresnel(jnp.asarray(1.0), None, 1.5, 2.0)) == pytest.approx((0.25 + 4) / (6.25 + 4))
