"""Sheen: its albedo in closed form, the fitted masking by its own words, where it gains."""

import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical
from gonio.models.microfacet.charlie import Charlie
from gonio.stability.albedos import reference_albedo


@pytest.mark.parametrize("alpha", [0.1, 0.3, 1.0])
def test_the_albedo_at_normal_incidence(alpha):
    # The visibility of Ashikhmin is ¼ there: with s = sin(θo/2), ∫ (2 + p) sᵖ (1 − 2s²) s ds from 0 to √½, p = 1/α.
    p = 1 / alpha
    found = directional_albedo(Charlie(jnp.asarray(alpha), "ashikhmin"), 0.0)
    assert found.value == pytest.approx(2 ** (-p / 2) / (p + 4), abs=2e-9)


@pytest.mark.parametrize("alpha", [1.0, 0.37])
def test_bounds_of_albedos_hold_for_wide_ones(alpha):
    """Against rings about the mirror direction, where sinθh to a small power has a point."""
    brdf = Charlie(jnp.asarray(alpha))
    for theta in np.radians([80.0, 89.9]):
        e, true = directional_albedo(brdf, theta, tolerance=1e-6), reference_albedo(brdf, theta)
        assert abs(float(e.value) - true.value) <= float(e.bound) + true.uncertainty


def test_the_fitted_masking_by_its_own_words():
    """Estevez & Kulla 2017, eq. 2 and 3, with angles; without eq. 4, the terminator's softening."""
    rng = np.random.default_rng(4)
    theta, phi = rng.uniform(0, 1.55, (2, 200)), rng.uniform(0, 6, (2, 200))

    def mask(cos_t, alpha):
        t = (1 - alpha) ** 2
        rough, smooth = np.array([21.5473, 3.82987, 0.19823, -1.97760, -4.32054]), [25.3245, 3.32435, 0.16801]
        a, b, c, d, e = rough * (1 - t) + np.array([*smooth, -1.27393, -4.85967]) * t

        def fit(x):
            return a / (1 + b * x**c) + d * x + e

        return np.where(cos_t < 0.5, np.exp(fit(cos_t)), np.exp(2 * fit(0.5) - fit(1 - cos_t)))

    wi, wo = (from_spherical(jnp.asarray(t), jnp.asarray(p)) for t, p in zip(theta, phi, strict=True))
    i, o = (np.array(w) for w in (wi, wo))
    half = (i + o) / np.linalg.norm(i + o, axis=0)
    theta_h = np.arctan2(np.hypot(half[0], half[1]), half[2])
    for alpha in (0.1, 0.7):
        density = (2 + 1 / alpha) * np.sin(theta_h) ** (1 / alpha) / (2 * np.pi)
        expected = density / (1 + mask(i[2], alpha) + mask(o[2], alpha)) / (4 * i[2] * o[2])
        np.testing.assert_allclose(evaluate(Charlie(jnp.asarray(alpha)), wi, wo), expected, rtol=1e-12)


def test_where_it_gains():
    # As `breaks` says.
    def albedo(alpha, cos_i, *visibility):
        return directional_albedo(Charlie(jnp.asarray(alpha), *visibility), np.arccos(cos_i), 0.0, 1e-4).value

    assert albedo(0.05, 0.01) == pytest.approx(1.07, abs=5e-3)
    assert albedo(0.01, 1e-3) == pytest.approx(2.1, abs=2e-2)
    assert albedo(0.1, 0.01, "ashikhmin") == pytest.approx(1.24, abs=5e-3)
    assert albedo(0.3, 0.01) < 1
