"""What facets do not reflect at once: the tables against other people's numbers, and what giving it back reaches."""

import csv
import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo
from gonio.models.diffuse.white_standard import WhiteStandard
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.fresnel import fresnel_average
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.microfacet import albedo_tables as albedo_table
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.microfacet.ggx import GGX
from support import helpers

THETA = np.radians([0.0, 45.0, 80.0, 89.0, 89.99])


@functools.partial(jax.jit, static_argnums=0)
def missing(name, mu, alpha):
    """1 − E at every cosine, and 1 − E_avg, from the table."""
    series = albedo_table.width_series(name, alpha)
    value = jax.vmap(lambda m: albedo_table.tabulated(name, series, m, alpha))(mu)
    return value, albedo_table.average(name, series, alpha)


def test_ggx_tables_against_other_peoples_integrals():
    """Albedos of F = 1 on file, good to 1e-10 there: to 3e-9, for both maskings."""
    with helpers.shared("oracle", "ggx_F1_albedo_float64.csv").open() as file:
        rows = list(csv.DictReader(file))
    for alpha in sorted({float(r["alpha"]) for r in rows}):
        mine = [r for r in rows if float(r["alpha"]) == alpha]
        mu = np.cos(np.radians([float(r["theta_i_deg"]) for r in mine]))
        for smith, column in (("correlated", "albedo_height_correlated"), ("separable", "albedo_separable_smith")):
            value, _ = missing(f"ggx_{smith}", mu, jnp.asarray(alpha))
            np.testing.assert_allclose(1 - value, [float(r[column]) for r in mine], rtol=0, atol=3e-9)


def test_ggx_tables_against_closed_forms():
    mu = np.array([1.0, 0.5, 1e-2, 1e-5, 1e-9])
    value, average = missing("ggx_correlated", mu, jnp.asarray(1.0))
    np.testing.assert_allclose(value, mu * np.log1p(1 / mu), rtol=0, atol=3e-9)
    assert average == pytest.approx(1 - 4 / 3 * (1 - np.log(2)), abs=1e-9)
    value, average = missing("ggx_separable", mu, jnp.asarray(1.0))
    np.testing.assert_allclose(value, 1 - 2 * (1 - np.log(2)) / (1 + mu), rtol=0, atol=3e-9)
    assert average == pytest.approx(1 - 4 * (1 - np.log(2)) ** 2, abs=1e-9)


@pytest.mark.parametrize("model", [GGX, Beckmann])
@pytest.mark.parametrize("energy", ["kulla_conty", "turquin"])
def test_white_facets_reflect_everything(model, energy):
    """E ≡ 1 for F = 1, at every width and both maskings, within 1e-8 and the bound of the integral."""
    smith = "correlated" if energy == "kulla_conty" else "separable"
    for alpha in (1e-4, 2e-3, 0.03, 0.3, 1.0):
        albedo = directional_albedo(model(alpha=alpha, smith=smith, energy=energy), THETA)
        assert np.all(np.abs(albedo.value - 1) <= 1e-8 + albedo.bound), alpha
        assert albedo.bound.max() < 1e-7


def test_coloured_facets_keep_within_what_they_receive():
    """Copper-like channels: between F_avg and 1 when the lost light is given back."""
    model = GGX(alpha=0.7, eta=[0.2, 0.9], k=[3.9, 2.5], energy="kulla_conty")
    value = directional_albedo(model, THETA).value
    assert np.all(value > 0.7 * np.asarray(fresnel_average(None, model.eta, model.k))) and np.all(value < 1)


def test_widest_ggx_given_back_is_the_white_standard():
    rng = np.random.default_rng(3)
    wi, wo = (from_spherical(rng.uniform(0, 1.57, 200), rng.uniform(0, 6.3, 200)) for _ in range(2))
    model = GGX(alpha=1.0, energy="kulla_conty")
    np.testing.assert_allclose(evaluate(model, wi, wo), evaluate(WhiteStandard(), wi, wo), rtol=3e-8)


def reference_average(eta, k=None):
    """2 ∫ F μ dμ by textbook Fresnel and mpmath."""
    n = mp.mpf(eta) if k is None else mp.mpc(eta, k)

    def weighted(c):
        t = mp.sqrt(1 - (1 - c * c) / n**2)
        return c * (abs((c - n * t) / (c + n * t)) ** 2 + abs((n * c - t) / (n * c + t)) ** 2)

    kink = [mp.sqrt(1 - n * n)] if k is None and eta < 1 else []
    return float(mp.quad(weighted, sorted([0, 0.01, 0.1, 1, *kink])))


def test_average_fresnel():
    assert fresnel_average(jnp.asarray(0.04), None, None) == pytest.approx(0.04 + 0.96 / 21)
    dielectric = jax.jit(jax.vmap(lambda e: fresnel_average(None, e, None)))
    eta = [0.01, 0.5, 0.999, 1.0001, 1.5, 4.0, 20.0]
    np.testing.assert_allclose(dielectric(jnp.asarray(eta)), [reference_average(e) for e in eta], rtol=0, atol=1e-14)
    eta, k = [0.2, 0.05, 1.5, 20.0, 0.5], [3.0, 2.0, 0.01, 50.0, 0.3]
    found = fresnel_average(None, jnp.asarray(eta), jnp.asarray(k))
    np.testing.assert_allclose(found, [reference_average(*p) for p in zip(eta, k, strict=True)], rtol=0, atol=1e-10)


def test_only_turquin_breaks_reciprocity_and_says_so():
    wi, wo = Direction(0.0, 0.0, 1.0), Direction(0.6, 0.0, 0.8)
    for energy, equal in (("single", True), ("kulla_conty", True), ("turquin", False)):
        model = GGX(alpha=1.0, energy=energy)
        there, back = (float(evaluate(model, *pair)) for pair in ((wi, wo), (wo, wi)))
        assert (abs(there - back) < 1e-14) is equal
        assert (model.violates == {}) is equal


def test_what_has_no_albedo_is_refused():
    with pytest.raises(GonioError, match="isotropic"):
        build("ggx(alpha_x=0.1, alpha_y=0.2, energy=kulla_conty)")
    with pytest.raises(GonioError, match="walter"):
        build("beckmann(alpha=0.1, smith=walter, energy=turquin)")
