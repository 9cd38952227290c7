"""Scatter of polished surfaces: an independent program's numbers, textbook digits, bands of roughness, what is left."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.integrate import quad

from gonio.checks.model.energy import specular_share
from gonio.models.albedo import directional_albedo
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build, to_expression
from gonio.models.fresnel import fresnel_conductor
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.surface_scatter.rayleigh_rice import total_integrated_scatter
from gonio.stability.textbook import TEXTBOOK
from support import helpers

SILICON = "rayleigh_rice(wavelength=0.532, eta=4.05, k=0.05, a=0.01, b=362, c=2.5)"
ALUMINIUM = "rayleigh_rice(wavelength=0.6328, eta=1.37, k=7.62, a=0.001, b=20, c=2)"
OTHERS = {
    "gaussian": "rayleigh_rice(wavelength=0.55, eta=1.5, sigma=0.005, tau=3, spectrum=gaussian)",
    "fractal": "rayleigh_rice(wavelength=0.55, eta=1.5, strength=1e-7, power=2.5, lowest=0.01, spectrum=fractal)",
    "table": 'rayleigh_rice(wavelength=0.55, eta=0.9, k=2, spectrum="table", psd="0.01:0.1 0.1:1e-5 1:1e-7")',
}


def pairs(count, seed=1):
    theta, phi = np.random.default_rng(seed).uniform(0, [[[1.55]], [[6.28]]], (2, 2, count))
    return [from_spherical(jnp.asarray(t), jnp.asarray(p)) for t, p in zip(theta, phi, strict=True)]


@pytest.mark.parametrize(("name", "expression"), [("Si", SILICON), ("Al", ALUMINIUM)])
def test_nist_scatmech(name, expression):
    d = np.load(helpers.shared("oracle", "scatmech_double.npz"))
    t_i, t_s, p_s = d["theta_i"], d["theta_s"], d["phi_s"]
    wi = Direction(np.sin(t_i), np.zeros_like(t_i), np.cos(t_i))
    wo = Direction(-np.sin(t_s) * np.cos(p_s), np.sin(t_s) * np.sin(p_s), np.cos(t_s))
    expected = d[f"Microroughness_ABC_{name}"][:, 0, 0]
    np.testing.assert_allclose(evaluate(build(expression), wi, wo), expected, rtol=1e-12)


@pytest.mark.parametrize("expression", [OTHERS["table"], OTHERS["fractal"]])
def test_textbook_digits(expression):
    """Forty-digit evaluation, from parameters parsed here by hand."""
    wi, wo = pairs(6)
    model = build(expression)
    options = {"spectrum": model.spectrum, "psd": model.psd}
    names = ("wavelength", "eta", "k", "a", "b", "c", "sigma", "tau", "strength", "power", "lowest")
    given = {n: mpf(float(getattr(model, n))) for n in names if getattr(model, n) is not None}
    with mp.workdps(40):
        exact = [
            float(TEXTBOOK["rayleigh_rice"](given, options, *(tuple(mpf(float(c[k])) for c in w) for w in (wi, wo))))
            for k in range(6)
        ]
    np.testing.assert_allclose(evaluate(model, wi, wo), exact, rtol=1e-11)


def test_numbers_of_mpmath_for_one_pair():
    """θi 30°, θs 50°, φs 20° from the mirror side: the formula typed once more."""
    wi = from_spherical(jnp.asarray(np.radians(30)), jnp.asarray(0.0))
    wo = from_spherical(jnp.asarray(np.radians(50)), jnp.asarray(np.radians(200)))
    assert float(evaluate(build(SILICON), wi, wo)) == pytest.approx(5.449065619932824e-6, rel=1e-12)


@pytest.mark.parametrize("expression", [SILICON, ALUMINIUM, *OTHERS.values()], ids=lambda e: e[-20:])
def test_the_rms_height_of_a_band_is_the_integral_of_the_spectrum(expression):
    model = build(expression)
    for low, high in ((0.0, 2.0), (0.02, 0.5)):
        edges = [1e-9, *np.geomspace(1e-3, 1, 7), 2.0]
        inside = np.unique(np.clip(edges, max(low, 1e-9), high))
        numeric = sum(
            quad(lambda f: 2 * np.pi * f * float(model.density(jnp.asarray(f * f))), a, b, epsrel=1e-10)[0]
            for a, b in itertools.pairwise(inside)
        )
        assert float(model.rms_height(low, high)) ** 2 == pytest.approx(numeric, rel=1e-6)


def test_tis_of_fifty_angstrom():
    assert total_integrated_scatter(5e-3, 0.5) == pytest.approx(0.015791, abs=5e-7)


def test_scattered_and_specular_light_are_what_a_smooth_surface_reflects():
    """Long waves scatter TIS · R close to the mirror direction; the rest is the specular share."""
    model = build("rayleigh_rice(wavelength=0.5, eta=1.37, k=7.62, sigma=0.002, tau=300, spectrum=gaussian)")
    theta = np.radians([0.0, 45.0])
    scattered = directional_albedo(model, theta).value
    smooth = np.asarray(fresnel_conductor(jnp.cos(theta), jnp.asarray(1.37), jnp.asarray(7.62)))
    np.testing.assert_allclose(scattered / smooth, total_integrated_scatter(0.002, 0.5, np.cos(theta)), rtol=2e-4)
    rest = specular_share(model, theta, np.zeros(2))[:, 0]
    np.testing.assert_allclose(scattered + rest, smooth, rtol=1e-5)
    assert float((0.5 * model).mirror_reflectance(Direction(0.0, 0.0, 1.0))) == pytest.approx(rest[0] / 2)


def test_limits_are_named_where_they_are_left():
    assert build(SILICON).validity_notes == ()
    rough, steep = (
        build(f"rayleigh_rice(wavelength=0.5, eta=1.5, sigma={s}, tau={t}, spectrum=gaussian)")
        for s, t in ((0.05, 10), (0.02, 0.3))
    )
    assert "4πσ" in rough.validity_notes[0] and "he_torrance" in rough.validity_notes[0]
    assert "slopes" in steep.validity_notes[-1]
    assert (0.5 * rough + build("lambert(rho=0.1)")).validity_notes == rough.validity_notes
    assert jax.jit(lambda m: len(m.validity_notes))(rough) == 0


@pytest.mark.parametrize("expression", OTHERS.values())
def test_expressions_come_back(expression):
    assert to_expression(build(to_expression(build(expression)))) == to_expression(build(expression))


@pytest.mark.parametrize(
    ("inside", "complaint"),
    [
        ("spectrum=gaussian, a=1", "a goes with spectrum=abc"),
        ("a=1, b=1", "no value for c"),
        ("spectrum=table", "no psd"),
        ("a=1, b=1, c=1, psd='1:2 2:1'", "has the spectrum"),
        ("spectrum=table, psd='1:2'", "pairs of a frequency"),
        ("spectrum=table, psd='2:2 1:2'", "increasing"),
        ("spectrum=table, psd='1:2 2:nan'", "pairs of a frequency"),
    ],
)
def test_what_contradicts_itself_is_refused(inside, complaint):
    with pytest.raises(GonioError, match=complaint):
        build(f"rayleigh_rice(wavelength=0.5, eta=1.5, {inside})")
