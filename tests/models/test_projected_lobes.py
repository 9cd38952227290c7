"""Lobes of direction cosines (ABC, Harvey-Shack, ABg): published fits, closed albedos, what is shift-invariant."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.surface_scatter.abc_smooth import ABCSmooth
from gonio.models.surface_scatter.harvey_shack import ABg, HarveyShack
from gonio.stability.precision import cast
from support import helpers

MU = np.array([1.0, 0.8, 0.3, 0.02, 1e-3])
THETA = np.arctan2(np.sqrt((1 - MU) * (1 + MU)), MU)


def test_abc_against_an_independent_implementation():
    """Same definition (their A is the scale); fits of Löw et al. 2012 stand on a Lambertian term."""
    found = 0
    for spelled, values, wi, wo in helpers.witnessed("LowSmooth"):
        b, c, eta = (jnp.asarray(float(v)) for v in re.findall(r"(?:B|C|eta) = ([\d.]+)", spelled))
        albedo, a = (np.array(v.split(","), float) for v in re.findall(r"(?:albedo|A) = \[([^\]]*)\]", spelled))
        lobe = np.asarray(evaluate(ABCSmooth(b, c, eta=eta), Direction(*wi), Direction(*wo)))
        f = lobe[:, None] * a + albedo / np.pi
        np.testing.assert_allclose(f, values, rtol=1e-12)
        found += 1
    assert found == 12


@pytest.mark.parametrize("b", [0.5, 1e3, 1e7])
def test_the_albedo_of_abc_at_every_incidence(b):
    # ∫ dβ/(1 + b|β−β0|²) over the unit disc, β0 at s from its centre, in closed form [Löw et al. 2012, eq. 19].
    s2 = 1 - MU**2
    root = np.sqrt(1 + 2 * b * (1 + s2) + (b * (1 - s2)) ** 2)
    expected = np.pi / b * np.log((1 + b * (1 - s2) + root) / 2)
    found = directional_albedo(ABCSmooth(jnp.asarray(b), jnp.asarray(1.0)), THETA, 0.4)
    np.testing.assert_allclose(found.value, expected, rtol=0, atol=1e-9)
    assert np.all(found.bound < 1e-9)


@pytest.mark.parametrize(("length", "slope"), [(0.01, -1.5), (1e-4, -3.0), (1.0, -10.0), (0.1, 0.0)])
def test_the_albedo_of_harvey_shack_at_normal_incidence(length, slope):
    power = slope / 2 + 1
    expected = np.pi * length**2 * ((1 + length**-2) ** power - 1) / power
    found = directional_albedo(HarveyShack(1.0, length, slope), 0.0)
    assert found.value == pytest.approx(expected, rel=1e-9)


def test_the_albedo_of_abg_at_normal_incidence():
    for b in (1e-6, 0.1):
        assert directional_albedo(ABg(0.5, b, 2.0), 0.0).value == pytest.approx(np.pi / 2 * np.log1p(1 / b), rel=1e-9)
    # ∫ 2πρ dρ/(b + √ρ) with t = √ρ: 4π ∫ t³/(b + t) dt from 0 to 1.
    b = 0.2
    expected = 4 * np.pi * (1 / 3 - b / 2 + b**2 - b**3 * np.log(1 + 1 / b))
    assert directional_albedo(ABg(1.0, b, 0.5), 0.0).value == pytest.approx(expected, rel=1e-9)


def test_abg_of_power_two_is_harvey_shack_of_slope_minus_two():
    rng = np.random.default_rng(2)
    wi, wo = (from_spherical(jnp.asarray(rng.uniform(0, 1.5, 200)), jnp.asarray(rng.uniform(0, 7, 200))) for _ in "io")
    length = 0.03
    np.testing.assert_allclose(
        evaluate(ABg(0.01, length**2, 2.0), wi, wo),
        evaluate(HarveyShack(0.01 / length**2, length, -2.0), wi, wo),
        1e-13,
    )


def test_the_value_depends_on_the_shift_alone():
    # Specular and 10 % off it, at several incidences.
    model = HarveyShack(2.0, 0.05, -1.7)
    sines = np.array([0.0, 0.3, 0.6, 0.85])
    wi = Direction(*(jnp.asarray(v) for v in (sines, 0 * sines, np.sqrt(1 - sines**2))))
    for shift in (0.0, 0.1):
        out = sines + shift
        wo = Direction(*(jnp.asarray(v) for v in (-out, 0 * out, np.sqrt(1 - out**2))))
        f = np.asarray(evaluate(model, wi, wo))
        np.testing.assert_allclose(f, 2.0 * (1 + (shift / 0.05) ** 2) ** -0.85, rtol=1e-12)


def test_a_cusp_has_its_height_in_the_mirror_direction():
    w = Direction(*(jnp.asarray(v) for v in (0.6, 0.0, 0.8)))
    m = Direction(-w.x, w.y, w.z)
    assert ABg(0.01, 1e-4, 0.5).f(w, m) == pytest.approx(100.0)
    assert ABg(0.01, 1.0, 0.0).f(w, m) == pytest.approx(0.005)


def test_a_narrow_abg_keeps_its_digits_to_the_mirror_direction():
    """Directions in single precision lie closer to the mirror than the roundings of 1, where its digits are those of
    their difference."""
    brdf = cast(build("abg(a=0.01, b=1e-12, g=1.5)"), np.float32)
    x = np.float32(0.5)
    beside = -np.nextafter(x, np.float32(1))
    with jax.enable_x64(False):
        f = evaluate(brdf, Direction(x, 0, x), Direction(beside, 0, x))
    exact = 0.01 / (np.float32(1e-12) + float(abs(x + beside)) ** 1.5)
    assert float(f) == pytest.approx(exact, rel=1e-5)
