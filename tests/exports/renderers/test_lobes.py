"""The NumPy lobes of renderers against closed forms, other quadratures and gonio's own models."""

import numpy as np
import pytest

from gonio.exports.pairs import polar_pairs
from gonio.exports.renderers import lobes
from gonio.exports.renderers.pbrt import under_coat
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

MU = np.array([0.1, 0.3, 0.6, 0.95])


def test_the_rule_integrates_a_diffuser_and_lobes():
    pairs = polar_pairs(6, 48, 12)
    np.testing.assert_allclose(pairs.weight.sum(), 1, rtol=1e-3)
    np.testing.assert_allclose(pairs.albedo(np.full((pairs.flux.size, 1), 1 / np.pi)), 1, atol=2e-3)
    mu = np.array([pairs.wi.z[pairs.incidence == k][0] for k in range(6)])
    for alpha in (0.02, 0.3, 1.0):
        white = lobes.ggx_albedos(mu, alpha)[0]
        np.testing.assert_allclose(pairs.albedo(lobes.ggx_facets(pairs, alpha, alpha))[:, 0], white, atol=8e-3)


def test_albedos_against_their_closed_form():
    """Of correlated GGX with α = 1 and F = 1: 1 − μ ln(1 + 1/μ)."""
    np.testing.assert_allclose(lobes.ggx_albedos(MU, 1.0)[0], 1 - MU * np.log1p(1 / MU), atol=2e-3)
    np.testing.assert_allclose(lobes.ggx_average(1.0), 1 - 2 * (2 / 3 * np.log(2) - 1 / 6), atol=2e-3)


def test_a_smooth_interface_shares_its_light_as_fresnel_says():
    reflected, passed = lobes.interface_shares(MU, 1e-3, 1.5)
    np.testing.assert_allclose(reflected, lobes.dielectric(MU, 1.5), atol=3e-3)
    np.testing.assert_allclose(reflected + passed, 1, atol=2e-3)
    pairs = polar_pairs(6, 16, 6)
    rho, back = 0.6, 1 - (1 - lobes.dielectric_average(np.asarray([1.5]))[0]) / 1.5**2
    t_i, t_o = (1 - lobes.dielectric(w.z, 1.5) for w in (pairs.wi, pairs.wo))
    expected = t_i * t_o * rho / (np.pi * 1.5**2 * (1 - rho * back))
    ours = under_coat(pairs, np.asarray([rho]), 1e-3, 1.5)[:, 0]
    ordinary = (pairs.wi.z > 0.1) & (pairs.wo.z > 0.1)
    np.testing.assert_allclose(ours[ordinary], expected[ordinary], rtol=0.01)


def test_a_white_base_under_a_coat_reflects_everything_but_what_rough_facets_lose():
    pairs, albedos = polar_pairs(6, 48, 8), []
    for alpha in (0.02, 0.1, 0.3):
        f = lobes.ggx_facets(pairs, alpha, alpha) * lobes.dielectric(pairs.cos_d, 1.5)
        albedo = pairs.albedo(f + under_coat(pairs, np.ones(1), alpha, 1.5))
        albedos.append(albedo[pairs.cosines > 0.3])
    np.testing.assert_allclose(albedos[0], 1, atol=0.01)
    assert np.all(albedos[0] > albedos[1]) and np.all(albedos[1] > albedos[2])


@pytest.mark.parametrize(
    ("expression", "ours"),
    [
        ("eon(rho=0.7, r=0.6)", lambda p: lobes.eon(p, 0.7, 0.6)),
        (
            "ggx(alpha_x=0.1, alpha_y=0.4, eta=[0.4, 1.5], k=[3.1, 0.2])",
            lambda p: (
                lobes.ggx_facets(p, 0.1, 0.4) * lobes.conductor(p.cos_d, np.array([0.4, 1.5]), np.array([3.1, 0.2]))
            ),
        ),
    ],
)
def test_values_are_those_of_the_models(expression, ours):
    pairs = polar_pairs(5, 12, 5, turns=2)
    expected = np.asarray(evaluate(build(expression), pairs.wi, pairs.wo)).reshape(pairs.flux.size, -1)
    np.testing.assert_allclose(ours(pairs), expected, rtol=1e-8, atol=1e-12)


def test_f82_is_tinted_at_82_degrees_and_schlick_elsewhere():
    f0, tint = np.array([0.9, 0.5]), np.array([0.7, 1.0])
    at_82 = lobes.f82(np.array([[1 / 7]]), f0, tint)[0]
    np.testing.assert_allclose(at_82, tint * lobes.schlick(1 / 7, f0))
    np.testing.assert_allclose(lobes.f82(np.array([[1.0]]), f0, tint)[0], f0)
    x, w = np.polynomial.legendre.leggauss(20)
    mu = (x[:, None] + 1) / 2
    np.testing.assert_allclose(lobes.f82_average(f0, tint), np.sum(w[:, None] * mu * lobes.f82(mu, f0, tint), axis=0))


def refracted_ways(wi, m, eta):
    """(reflected, refracted, Fresnel) of directions wi (3, n) at facets m."""
    cos_i = np.sum(wi * m, axis=0)
    cos_t = np.sqrt(np.maximum(1 - (1 - cos_i**2) / eta**2, 0))
    r_s, r_p = ((cos_i - eta * cos_t) / (cos_i + eta * cos_t), (eta * cos_i - cos_t) / (eta * cos_i + cos_t))
    total = (1 - cos_i**2) / eta**2 >= 1
    return 2 * cos_i * m - wi, (cos_i / eta - cos_t) * m - wi / eta, np.where(total, 1.0, (r_s**2 + r_p**2) / 2)


def met_facet(rng, w, alpha, eta):
    """(direction after a rough interface that is met from above, weight): facets by D cosθ, one way at random."""
    n = w.shape[1]
    u, phi = rng.random(n), 2 * np.pi * rng.random(n)
    tan = alpha * np.sqrt(u / (1 - u))
    m = np.array([tan * np.cos(phi), tan * np.sin(phi), np.ones(n)]) / np.sqrt(1 + tan**2)
    cos_m = np.sum(w * m, axis=0)
    reflected, through, fresnel = refracted_ways(w, m, eta)
    back = rng.random(n) < fresnel
    out = np.where(back, reflected, through)
    lam = [0.5 * (np.sqrt(1 + alpha**2 * (1 / z**2 - 1)) - 1) for z in (w[2], np.where(out[2] == 0, 1e-9, out[2]))]
    right = (cos_m > 0) & np.where(back, out[2] > 0, out[2] < 0)
    return out, np.where(right, cos_m / (w[2] * m[2]) / (1 + lam[0] + lam[1]), 0.0)


@pytest.mark.parametrize("mu", [0.9, 0.4])
def test_a_coated_diffuser_against_a_walk_between_its_layers(mu):
    """As pbrt walks: interface, base, interface, with a weight; here photon by photon from the light's side."""
    alpha, eta, rho, n, rng = 0.3, 1.5, 0.8, 200_000, np.random.default_rng(5)
    wi = np.repeat(np.array([[np.sqrt(1 - mu * mu)], [0.0], [mu]]), n, axis=1)
    out, weight = met_facet(rng, wi, alpha, eta)
    albedo = np.where(out[2] > 0, weight, 0.0).sum()
    weight = weight[out[2] < 0]
    for _ in range(40):
        u, phi = rng.random(weight.size), 2 * np.pi * rng.random(weight.size)
        up = np.array([np.sqrt(u) * np.cos(phi), np.sqrt(u) * np.sin(phi), np.sqrt(1 - u)])
        out, step = met_facet(rng, up, alpha, 1 / eta)  # seen from inside: up is the interface's front
        weight = weight * rho * step
        albedo += weight[out[2] < 0].sum()
        weight = weight[out[2] > 0]
    pairs = polar_pairs(12, 32, 8)
    f = lobes.ggx_facets(pairs, alpha, alpha) * lobes.dielectric(pairs.cos_d, eta)
    ours = pairs.albedo(f + under_coat(pairs, np.asarray([rho]), alpha, eta))[:, 0]
    lights = np.array([pairs.wi.z[pairs.incidence == k][0] for k in range(12)])
    np.testing.assert_allclose(np.interp(mu, lights[::-1], ours[::-1]), albedo / n, rtol=0.015)
