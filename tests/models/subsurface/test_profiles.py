"""Profiles of light below the surface beside their closed forms, quadrature and a half space by Monte Carlo."""

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy import special

from gonio.models.errors import GonioError
from gonio.models.expression.builder import build, to_expression
from gonio.models.geometry.directions import from_spherical
from gonio.models.subsurface.base import Position
from gonio.models.subsurface.catalog import BSSRDFS
from gonio.models.subsurface.evaluation import evaluated, totals
from gonio.models.subsurface.internal_reflection import first_moment, second_moment
from support.half_space import fresnel, total_with_error

ALBEDOS = np.array([0.8, 0.95, 0.99])
RADII = np.array([1.0, 3.0, 10.0, 30.0])
MATCHED = {name: kind(albedo=ALBEDOS, mfp=np.ones(3), eta=np.ones(3)) for name, kind in BSSRDFS.items()}
GLASSY = {
    name: kind(albedo=np.array([0.995, 0.9, 0.4]), mfp=np.array([0.5, 0.9, 0.6]), eta=np.full(3, 1.4))  # one program
    for name, kind in BSSRDFS.items()
}


def test_totals_are_those_of_the_published_forms():
    s = np.sqrt(3 * (1 - ALBEDOS))
    assert totals(MATCHED["dipole"]) == pytest.approx(ALBEDOS / 2 * (1 + np.exp(-4 * s / 3)) * np.exp(-s), abs=1e-12)
    d, root = 4 * np.sqrt((1 - ALBEDOS) * (2 - ALBEDOS) / 3), np.sqrt(3 * (1 - ALBEDOS) / (2 - ALBEDOS))
    fluence = 0.25 * (1 - np.exp(-d)) / (d / 4)
    better = ALBEDOS**2 / 2 * np.exp(-root) * (0.5 * (1 + np.exp(-d)) + fluence)
    assert totals(MATCHED["better_dipole"]) == pytest.approx(better, abs=1e-12)
    exact = [0.285255, 0.535541]  # of a half space, by H functions
    assert totals(MATCHED["normalised_diffusion"])[:2] == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("name", BSSRDFS)
def test_the_integrals_are_those_of_the_profile(name):
    model = GLASSY[name]
    cuts = np.concatenate([[0.0], np.geomspace(0.01, 400.0, 40)])
    x, w = np.polynomial.legendre.leggauss(24)
    r = (cuts[:-1, None] + np.diff(cuts)[:, None] / 2 * (1 + x)).ravel()
    ring = (np.diff(cuts)[:, None] / 2 * w).ravel() * 2 * np.pi * r
    light = evaluated(model, "profile", r) * ring[:, None]
    assert evaluated(model, "cumulative", cuts[10]) == pytest.approx(light[r < cuts[10]].sum(0), abs=1e-10)
    assert totals(model) == pytest.approx(light.sum(0), abs=1e-10)
    assert evaluated(model, "hankel", 0.7) == pytest.approx((light * special.j0(0.7 * r)[:, None]).sum(0), abs=1e-10)


def test_moments_of_the_reflection_from_within():
    moments = [(power, jax.jit(moment)) for power, moment in ((1, first_moment), (2, second_moment))]
    for eta in (1.0, 1.3, 2.0):
        critical = np.sqrt(1 - 1 / eta**2)
        x, w = np.polynomial.legendre.leggauss(200)
        u = (x + 1) / 2
        mu, weight = critical + (1 - critical) * u**4, (1 - critical) * 2 * u**3 * w
        for power, moment in moments:
            exact = critical ** (power + 1) + (power + 1) * np.sum(weight * fresnel(mu, eta) * mu**power)
            assert float(moment(np.asarray(eta))) == pytest.approx(exact, abs=1e-8)


def test_a_half_space_by_monte_carlo_says_how_far_each_model_is_off():
    total, error, beyond, spread = total_with_error(0.8, 60_000, seed=3)
    assert total == pytest.approx(0.285255, abs=4 * error)
    assert beyond[:2] == pytest.approx([0.356, 0.0645], abs=0.0005 + 4 * spread[:2].max())
    assert totals(MATCHED["dipole"])[0] / total == pytest.approx(0.88, abs=0.02)
    assert totals(MATCHED["better_dipole"])[0] / total == pytest.approx(0.70, abs=0.02)
    shape = 1 - evaluated(MATCHED["normalised_diffusion"], "cumulative", RADII)[:2, 0] / total
    assert shape == pytest.approx(beyond[:2], abs=0.02)


def test_light_and_detector_may_change_places():
    model = GLASSY["dipole"]
    here, there = Position(0.0, 0.0), Position(1.2, -0.4)
    wi, wo = (from_spherical(t, p, np) for t, p in ((0.3, 0.1), (1.2, 2.0)))
    s = eqx.filter_jit(lambda *arguments: model.s(*arguments))
    assert np.asarray(s(here, wi, there, wo)) == pytest.approx(np.asarray(s(there, wo, here, wi)), rel=1e-13)


def test_the_same_material_in_both_ways_of_saying_it():
    one, other = build("dipole(sigma_a=0.1, sigma_s=1.8, g=0.5)"), build("dipole(albedo=0.9, mfp=1)")
    for coefficient in ("absorption", "scattering", "extinction"):
        values = [float(getattr(model.bssrdf, coefficient)) for model in (one, other)]
        assert values[0] == pytest.approx(values[1])
    assert to_expression(build(to_expression(one))) == to_expression(one)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("dipole", "one pair"),
        ("dipole(sigma_a=1, albedo=0.3)", "one pair"),
        ("dipole(sigma_a=1, sigma_s=?)", "no value for sigma_s"),
        ("dipole(sigma_a=1, sigma_s=1) + lambert(rho=0.3)", "stands alone"),
        ("lambert(rho=0.3) + dipole(sigma_a=1, sigma_s=1)", "BSSRDF"),
        ("dipole(sigma_a=-1, sigma_s=1)", "outside of its domain"),
        ("dipole(sigma_a=[1, 2], sigma_s=[1, 2, 3])", "2 and 3"),
    ],
)
def test_what_is_no_model_is_refused_in_one_sentence(text, why):
    with pytest.raises(GonioError, match=why):
        build(text)
