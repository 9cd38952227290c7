"""Lafortune's lobe: published fits, the Phong lobe inside it, its height, overflow."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.empirical.lafortune import Lafortune
from gonio.models.empirical.phong import Phong
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical
from support import helpers


def lobe(c_xy, c_z, n, norm="lafortune"):
    return Lafortune(*(jnp.asarray(v, float) for v in (c_xy, c_xy, c_z, n)), norm)


def test_values_against_an_independent_implementation():
    """Same definition; the fits of Ngan et al. 2005 stand on a Lambertian term."""
    found = 0
    for spelled, values, wi, wo in helpers.witnessed("Lafortune("):
        numbers = {k: float(v) for k, v in re.findall(r"(Cxy|Cz|sharpness) ?= ?([-\d.e]+)", spelled)}
        albedos = [np.array(a.split(","), float) for a in re.findall(r"albedo ?= ?\[([^\]]*)\]", spelled)]
        ours = lobe(numbers["Cxy"], numbers["Cz"], numbers["sharpness"], "ngan" if "Ngan" in spelled else "lafortune")
        f = np.asarray(evaluate(ours, Direction(*wi), Direction(*wo)))[:, None] * albedos[-1]
        if len(albedos) == 2:
            f = f + albedos[0] / np.pi
        np.testing.assert_allclose(f, values, rtol=1e-12, atol=1e-18)
        found += 1
    assert found == 12


def test_equal_weights_are_phongs_lobe():
    rng = np.random.default_rng(3)
    wi, wo = (from_spherical(jnp.asarray(rng.uniform(0, 1.5, 300)), jnp.asarray(rng.uniform(0, 7, 300))) for _ in "io")
    for n in (0.5, 40.0, 5000.0):
        ours = evaluate(lobe(-0.7, 0.7, n, "ngan"), wi, wo)
        np.testing.assert_allclose(ours, evaluate(Phong(jnp.asarray(n)), wi, wo), rtol=1e-12, atol=1e-200)


def test_the_albedo_at_normal_incidence():
    # The lobe stands on the normal: 2π c_zⁿ/(n+2) as written, 1 in the form of Ngan et al.
    for n in (0.0, 3.0, 1e4):
        height = 1.02 if n < 1e4 else 1.001
        found = directional_albedo(lobe(-0.9, height, n), 0.0)
        assert found.value == pytest.approx(2 * np.pi / (n + 2) * height**n, rel=1e-11)
        assert directional_albedo(lobe(-0.9, height, n, "ngan"), 0.0).value == pytest.approx(1, abs=1e-12)


def test_the_normalised_form_conserves_energy():
    # Grazing included: |(c_x wi.x, c_y wi.y, c_z wi.z)| is at most the largest weight.
    theta = np.radians([0, 30, 60, 80, 89])
    for c_xy, c_z in ((-0.67, 0.33), (0.6, 0.6), (0.9, 0.1)):
        found = directional_albedo(lobe(c_xy, c_z, 4.0, "ngan"), theta)
        assert np.all(found.bound < 1e-8)
        assert np.all(found.value <= 1)


def test_what_would_overflow_is_held():
    w = Direction(*(jnp.asarray(v) for v in (0.6, 0.0, 0.8)))
    value, slope = jax.jit(jax.value_and_grad(lambda n: lobe(2.0, 2.0, n).f(w, w)))(1e5)
    assert np.isfinite(value)
    assert np.isfinite(slope)
    assert value > 1e290


def test_isotropic_where_the_weights_are_equal():
    assert lobe(-0.5, 0.5, 3.0).isotropic
    assert not Lafortune(-0.5, -0.6, 0.5, 3.0).isotropic
