"""Disc apertures: averages against brute force and closed forms, second order in the disc, reciprocity, honesty."""

import math

import numpy as np
import pytest

from gonio.instrument.aperture import average, irradiance
from gonio.models.brdf import AbstractBRDF, terms
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.solid_angle import projected_cap
from support.marks import thorough

GLOSSY = build("lambert(rho=[.1,.2,.4]) + [1,.8,.6]*ggx(alpha=.2, eta=1.5)")


def directions(theta, phi):
    theta, phi = np.radians(theta), np.radians(phi)
    return Direction(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi)


def relative(tolerance):
    return lambda f, _: tolerance * np.maximum(np.abs(f), 1e-8)


WI = directions(np.array([0.0, 30.0, 40.0, 60.0, 80.0, 50.0]), np.array([0.0, 0.0, 70.0, 10.0, 0.0, 200.0]))
WO = directions(np.array([0.0, 33.0, 5.0, 62.0, 75.0, 50.0]), np.array([0.0, 180.0, 250.0, 185.0, 20.0, 200.0]))


def brute_force(brdf, wi, wo, s_i, s_o, n=40):
    """The definition, by midpoints in polar coordinates about each axis: nothing in common with the rule under test."""

    def disc(w, s):
        w = np.array(w)
        if s == 0:
            return w[:, None], np.ones(1)
        polar, azimuth = (np.arange(n) + 0.5) / n * s, (np.arange(3 * n) + 0.5) / (3 * n) * 2 * np.pi
        a = np.cross(w, [0.3, -0.5, 0.81])
        a /= np.linalg.norm(a)
        b = np.cross(w, a)
        p, q = (g.ravel() for g in np.meshgrid(polar, azimuth))
        rays = np.outer(w, np.cos(p)) + np.outer(a, np.sin(p) * np.cos(q)) + np.outer(b, np.sin(p) * np.sin(q))
        weight = np.sin(p) * np.maximum(rays[2], 0)
        return rays, weight

    (rays_i, c_i), (rays_o, c_o) = disc(wi, s_i), disc(wo, s_o)
    total = 0.0
    for ray, weight in zip(rays_i.T, c_i, strict=True):
        if weight > 0:
            total = total + weight * (c_o @ np.asarray(brdf(ray, rays_o)))
    return total / (c_i.sum() * c_o.sum())


def lobe(ray_i, rays_o):
    """GGX with separable masking and F = 1, α = 0.15, written out in NumPy."""
    alpha = 0.15
    h = ray_i[:, None] + rays_o
    h = h / np.linalg.norm(h, axis=0)
    density = alpha**2 / (np.pi * (h[2] ** 2 * (alpha**2 - 1) + 1) ** 2)

    def masked(z):
        return z + np.sqrt(alpha**2 + (1 - alpha**2) * z**2)

    up = rays_o[2] > 0
    z_o = np.where(up, rays_o[2], 1.0)
    return np.where(up, density / (masked(ray_i[2]) * masked(z_o)), 0.0)[:, None]


@pytest.mark.parametrize(("s_i", "s_o"), [(2.0, 3.0), (0.0, 4.0), *thorough((4.0, 0.0))])
def test_readings_are_the_average_of_the_definition(s_i, s_o):
    s_i, s_o = math.radians(s_i), math.radians(s_o)
    brdf = build('ggx(alpha=0.15, smith="separable")')
    values, error = average(brdf, WI, WO, s_i, s_o, relative(1e-4))
    for k in range(WI.x.size):
        wi, wo = ([c[k] for c in w] for w in (WI, WO))
        truth = brute_force(lobe, wi, wo, s_i, s_o, n=20 if s_i and s_o else 60)
        assert values[k, 0] == pytest.approx(truth[0], rel=2e-3 if s_i and s_o else 4e-4)
    assert (error <= 1e-4 * values).all()


def test_discs_across_the_horizon_read_what_is_above_it():
    s = math.radians(5)
    wi = directions(np.array([88.0, 89.9, 86.0, 30.0]), np.zeros(4))
    wo = directions(np.array([87.0, 40.0, 89.0, 89.5]), np.full(4, 180.0))
    brdf = build('ggx(alpha=0.15, smith="separable")')
    values, error = average(brdf, wi, wo, s, s, relative(1e-3))
    for k in range(4):
        truth = brute_force(lobe, [c[k] for c in wi], [c[k] for c in wo], s, s, n=20)
        assert values[k, 0] == pytest.approx(truth[0], rel=1e-2)
    assert (error <= 1e-3 * values).all()
    below, _ = average(
        brdf,
        directions(np.array([96.0]), np.zeros(1)),
        WO._replace(**{c: getattr(WO, c)[:1] for c in "xyz"}),
        s,
        s,
        relative(1e-3),
    )
    assert below == 0


def test_a_perfect_diffuser_reads_the_same_through_any_discs():
    wi, wo = (
        directions(np.array([0.0, 45.0, 85.0, 89.0]), np.zeros(4)),
        directions(np.array([10.0, 70.0, 88.0, 20.0]), np.full(4, 40.0)),
    )
    for s_i, s_o in ((0.0, 0.01), (0.1, 0.1), (0.5, 0.02)):
        values, error = average(build("lambert(rho=0.8)"), wi, wo, s_i, s_o, relative(1e-10))
        np.testing.assert_allclose(values, 0.8 / np.pi, rtol=1e-13)
        assert error.max() < 1e-13


@pytest.mark.parametrize(("s_i", "s_o"), [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)])
def test_readings_converge_to_the_analytic_value_at_second_order(s_i, s_o):
    exact = np.asarray(evaluate(GLOSSY, WI, WO))[:, :1]
    sizes = np.radians([1.0, 0.5, 0.25])
    off = np.array([average(GLOSSY, WI, WO, s * s_i, s * s_o, relative(1e-9))[0][:, :1] - exact for s in sizes])
    curved = np.abs(off[0] / exact) > 1e-4
    assert curved.sum() >= 4, "there is something to converge"
    ratio = off[:-1, curved] / off[1:, curved]
    assert np.abs(ratio - 4).max() < 0.08
    assert np.abs(ratio[-1] - 4).max() < 0.02


def test_equal_discs_read_reciprocally_and_alike_in_mirrored_geometries():
    s = math.radians(2)
    there, _ = average(GLOSSY, WI, WO, s, s, relative(1e-6))
    back, _ = average(GLOSSY, WO, WI, s, s, relative(1e-6))
    np.testing.assert_allclose(back, there, rtol=1e-12)
    flipped = [w._replace(y=-w.y) for w in (WI, WO)]
    np.testing.assert_allclose(average(GLOSSY, *flipped, s, s, relative(1e-6))[0], there, rtol=1e-12)


def test_a_peak_between_the_rays_is_not_missed():
    """Mirror reflection near the rim of the discs: a lobe far narrower than the spacing of the first rays."""
    s = math.radians(2.5)
    wi, wo = directions(np.array([20.0, 20.0]), np.zeros(2)), directions(np.array([22.0, 24.0]), np.full(2, 180.0))
    values, error = average(build("beckmann(alpha=0.004)"), wi, wo, s, s, relative(1e-3))
    # All light of the lens that both discs share reaches the detector: for a narrow lobe, whose masking is 1,
    # reading ≈ lens/(source disc) / (∫cosθo dωo), the lens of two circles of radius s, their centres d apart.
    d = np.radians([2.0, 4.0])
    lens = (2 * s**2 * np.arccos(d / (2 * s)) - d / 2 * np.sqrt(4 * s**2 - d**2)) / (math.pi * s**2)
    expected = lens / np.asarray(projected_cap(s, np.radians([22.0, 24.0])))
    np.testing.assert_allclose(values[:, 0], expected, rtol=0.15)
    assert (error <= 1e-3 * values).all()


def test_what_cannot_be_resolved_keeps_a_large_error():
    wi, wo = directions(np.array([85.0]), np.zeros(1)), directions(np.array([85.0]), np.full(1, 180.0))
    values, error = average(build("ggx(alpha=0.0005)"), wi, wo, 0.05, 0.05, relative(1e-4))
    assert error[0, 0] > 1e-2 * values[0, 0]


class Cosine(AbstractBRDF):
    """f = cosθi + 2 cosθo: its averages over whole discs have a closed form."""

    def formula(self, wi, wo):
        return wi.z + 2 * wo.z


def test_polynomials_are_averaged_to_rounding():
    s = np.array([0.3, 0.2])
    theta = np.radians([10.0, 60.0])
    wi, wo = directions(np.degrees(theta), np.zeros(2)), directions(np.degrees(theta[::-1]), np.ones(2))
    values, _ = average(Cosine(), wi, wo, *s, relative(1e-12))

    def mean_cosine(angle, half):
        # ∫cos²θ dω / ∫cosθ dω over a cap: with c = cos of the angle to its axis, ½ sin²θ (1 − c²) + cos²θ c².
        b = math.cos(half)
        c0, c2 = 1 - b, (1 - b**3) / 3
        square = 2 * np.pi * (np.cos(angle) ** 2 * c2 + 0.5 * np.sin(angle) ** 2 * (c0 - c2))
        return square / (np.pi * math.sin(half) ** 2 * np.cos(angle))

    expected = mean_cosine(theta, s[0]) + 2 * mean_cosine(theta[::-1], s[1])
    np.testing.assert_allclose(values[:, 0], expected, rtol=1e-12)
    assert len(terms(Cosine())) == 1


@pytest.mark.thorough
def test_a_values_bits_do_not_depend_on_its_neighbours():
    rng = np.random.default_rng(2)
    n = 60
    wi = directions(rng.uniform(0, 88, n), rng.uniform(0, 360, n))
    wo = directions(rng.uniform(0, 88, n), rng.uniform(0, 360, n))
    s = math.radians(3)
    whole, error = average(GLOSSY, wi, wo, s, s, relative(1e-4))
    for a, b in ((0, 1), (1, 23), (23, n)):
        part = [Direction(*(c[a:b] for c in w)) for w in (wi, wo)]
        values, e = average(GLOSSY, *part, s, s, relative(1e-4))
        np.testing.assert_array_equal(values, whole[a:b])
        np.testing.assert_array_equal(e, error[a:b])


def test_irradiance_is_the_discs_projected_solid_angle():
    s = math.radians(4)
    theta = np.radians([0.0, 30.0, 85.0, 87.0, 90.0, 93.0])
    relative_irradiance = irradiance(np.cos(theta), s)
    np.testing.assert_allclose(relative_irradiance[:3], np.cos(theta[:3]), rtol=1e-14)
    polar, azimuth = np.meshgrid((np.arange(800) + 0.5) / 800 * s, (np.arange(800) + 0.5) / 800 * 2 * np.pi)
    for k in (3, 4, 5):
        z = np.cos(theta[k]) * np.cos(polar) + np.sin(theta[k]) * np.sin(polar) * np.cos(azimuth)
        above = np.mean(np.sin(polar) * np.maximum(z, 0)) * s * 2 * np.pi / (np.pi * math.sin(s) ** 2)
        assert relative_irradiance[k] == pytest.approx(above, rel=1e-4)


def test_two_rules_that_agree_by_accident_do_not_end_the_climb():
    """In a highlight that is narrower than both discs: some readings were off by 4 times what is allowed."""
    phi, s = np.linspace(175.6, 175.8, 5), math.radians(2)
    pair = directions(23.8 + 0 * phi, 0 * phi), directions(23.9 + 0 * phi, phi)
    brdf = build("ggx(alpha=0.02, f0=0.04)")
    rough, fine = (average(brdf, *pair, s, s, relative(tolerance))[0] for tolerance in (1e-3, 1e-4))
    np.testing.assert_allclose(rough, fine, rtol=1e-3)
