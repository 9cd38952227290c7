"""Kelemen and Szirmay-Kalos: the albedo of the specular term in closed form, and energy."""

import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from gonio.models.layered.kelemen import Kelemen, KelemenLobe

THETA = np.radians([0.0, 45.0, 80.0, 89.0, 89.99])


def test_specular_albedo_at_normal_incidence():
    """F = 1: ∫ (1 − p²) e^(−p²/α²)/(πα²) dp² over slopes p < 1, so E = 1 − α² (1 − e^(−1/α²))."""
    for alpha in (1e-3, 0.3, 1.0):
        albedo = directional_albedo(KelemenLobe(jnp.asarray(alpha), jnp.asarray(1.0)), [0.0])
        assert albedo.value[0] == pytest.approx(1 - alpha**2 * -np.expm1(-1 / alpha**2), abs=1e-9)


def test_peak_in_the_mirror_direction():
    """F D/(4 cos²θ_d), D = 1/(πα²): at 60° four times as high as at normal incidence for F = 1."""
    wi, wo = Direction(np.sqrt(0.75), 0.0, 0.5), Direction(-np.sqrt(0.75), 0.0, 0.5)
    peak = float(evaluate(KelemenLobe(jnp.asarray(0.1), jnp.asarray(1.0)), wi, wo))
    assert peak == pytest.approx(1 / (np.pi * 0.1**2), rel=1e-13)


@pytest.mark.parametrize("f0", [0.0, 1.0])
def test_white_matte_part_makes_it_reflect_everything(f0):
    for alpha in (1e-4, 0.02, 0.3, 1.0):
        albedo = directional_albedo(Kelemen(rho=1.0, alpha=alpha, f0=f0), THETA)
        assert np.all(np.abs(albedo.value - 1) <= 3e-8 + albedo.bound) and albedo.bound.max() < 2e-7


def test_less_than_white_without_the_matte_part():
    albedo = directional_albedo(Kelemen(rho=0.0, alpha=0.2, f0=[0.04, 1.0]), THETA)
    assert np.all(albedo.value + albedo.bound < 1)
