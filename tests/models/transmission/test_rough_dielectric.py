"""A rough interface: other people's shares and values, the energy of its formula, limits of its index, its samplers."""

import itertools

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import erf

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate, evaluate_in_blocks
from gonio.models.expression.builder import build
from gonio.models.fresnel import fresnel_dielectric_inside
from gonio.models.geometry.directions import from_spherical
from gonio.models.special.log_beta import log_beta
from gonio.models.transmission.rough_dielectric import RoughDielectric, RoughReflection, RoughRefraction
from gonio.stability.samplers import count_and_expect, p_value
from gonio.stability.values_and_gradients import value_cells
from support import helpers
from support.marks import thorough

SHARES = [
    (0.1, 0, 0.03964, 0.95922),
    (0.1, 60, 0.08588, 0.90635),
    (0.3, 60, 0.06098, 0.88555),
    (0.5, 80, 0.08283, 0.59991),
    (0.1, 120, 0.94034, 0.02303),
    (0.5, 100, 0.59893, 0.03133),
]
"""α, θi in degrees (beyond 90: inside), R and T of η = 1.5 by 2000² visible normals of another program."""


def test_shares_against_other_peoples_visible_normals():
    for alpha in (0.1, 0.3, 0.5):
        rows = np.array([row[1:] for row in SHARES if row[0] == alpha])
        model, theta = RoughDielectric(alpha=alpha, eta=1.5), np.radians(rows[:, 0])
        r, t = directional_albedo(model, theta, tolerance=1e-5), directional_transmittance(model, theta, tolerance=1e-6)
        assert np.all(np.abs(r.value - rows[:, 1]) < 1e-5 + r.bound)
        assert np.all(np.abs(t.value - rows[:, 2]) < 3e-5) and np.all(t.bound < 1e-6)


def test_values_against_a_renderer_on_the_whole_sphere():
    """Its eval is f cosθo, over η² in transmission; in single precision, which near total reflection has few digits.

    The differences (3.3e-4 for α = 0.01, 1.5e-4 for 0.05, else below 1e-4) are those of single precision: the same
    formula in double precision, at directions made units in double precision, is ours to 1e-12; of errors of 2⁻²⁴ in
    each of its steps, drawn at random, it has 2e-4 rms in these two directions, and a thousandth of that of errors of
    2⁻³⁴; and every stored value differs by no more than 1.4 times the largest of a hundred such draws
    (tests/benchmarks/models/rough_dielectric_precision.py).
    """
    for name, said, wi, wo, f_cos, _ in helpers.mitsuba("roughdielectric"):
        eta = said["int_ior"] / said["ext_ior"]
        x, y = (said.get(axis, said.get("alpha")) for axis in ("alpha_u", "alpha_v"))
        smith = "walter" if said["distribution"] == "beckmann" else "separable"
        model = RoughDielectric(alpha_x=x, alpha_y=y, eta=eta, distribution=said["distribution"], smith=smith)
        opposite, front = wi.z * wo.z < 0, wi.z > 0
        ours = evaluate_in_blocks(model, wi, wo)[:, 0] * np.abs(wo.z)
        ours /= np.where(opposite, np.where(front, eta**2, eta**-2), 1.0)
        expected = f_cos.reshape(wi.z.size, -1)[:, 0]
        # The cosine of what is refracted into the rarer medium, on its facet, is the root of a difference.
        h = np.stack(wi) + eta ** np.where(front, 1.0, -1.0) * np.stack(wo)
        cos_rare = np.abs(np.sum(np.stack(np.where(front, np.stack(wi), np.stack(wo))) * h, 0)) / np.linalg.norm(
            h, axis=0
        )
        allowed = np.where(opposite, np.maximum(1e-4, 6e-7 / cos_rare**2), 1e-4)
        assert np.all(np.abs(ours - expected) < allowed * np.maximum(expected, 1e-6)), name


class ReflectionOnce(RoughReflection):
    def masking(self, wi, wo):
        return 1.0 / (self.cos_over_g1(wi, self.alpha_x, self.alpha_y) * wo.z)


class RefractionOnce(RoughRefraction):
    def masking(self, wi, wo):
        return 1.0 / (self.cos_over_g1(wi, self.alpha_x, self.alpha_y) * wo.z)


PANELS, PANEL = 24, 24
"""Of Gauss's rule over the tilt of facets, beside those that end where a piece of azimuths begins."""


class VisibleFacets:
    """Facets that light from theta (beyond π/2: from behind) sees, tanθm = α tan ψ, without gonio's formulas."""

    def __init__(self, distribution, alpha, eta, theta):
        self.distribution, self.alpha = distribution, alpha
        self.ratio, theta = (1 / eta, theta) if theta < np.pi / 2 else (eta, np.pi - theta)
        self.c, self.s = np.cos(theta), np.sin(theta)

    def tilt(self, psi):
        cm = 1 / np.hypot(1.0, self.alpha * np.tan(psi))
        return cm, self.alpha * np.tan(psi) * cm

    def cuts(self, psi):
        """Cosines i·m at which facets turn away, mirror to the horizon, reflect all, and refract to the horizon."""
        cm, ratio = self.tilt(psi)[0], self.ratio
        ahead, total = self.c / cm, np.sqrt(max(0.0, 1 - 1 / ratio**2))
        refracted = (ahead**2 + 1 - 1 / ratio**2) / (2 * ahead) if ratio > 1 else -np.ones_like(cm)
        return np.stack([np.zeros_like(cm), ahead / 2, np.full_like(cm, total), refracted])

    def panels(self):
        """Edges in ψ: at each end of a range of azimuths, and even ones between."""
        edges = np.linspace(0, np.pi / 2, PANELS + 1)
        psi = np.linspace(1e-6, np.pi / 2 - 1e-6, 3000)
        for sign, k in itertools.product((1, -1), range(4)):

            def gap(at, sign=sign, k=k):
                cm, sm = self.tilt(at)
                return self.cuts(at)[k] - self.c * cm + sign * self.s * sm

            y = gap(psi)
            for j in np.flatnonzero(y[:-1] * y[1:] < 0):
                edges = np.append(edges, brentq(gap, psi[j], psi[j + 1], xtol=1e-14))
        return np.sort(edges)

    def area(self, cm, sm):
        """D G₁/cosθi, 1/sr."""
        alpha, tangent = self.alpha, max(self.s, 1e-300) / self.c
        if self.distribution == "ggx":
            d = alpha**2 / (np.pi * (cm**2 * alpha**2 + sm**2) ** 2)
            return d * 2 / (1 + np.sqrt(1 + (alpha * tangent) ** 2)) / self.c
        a = min(1 / (alpha * tangent), 1e3)
        d = np.exp(-((sm / cm / alpha) ** 2)) / (np.pi * alpha**2 * cm**4)
        return d * 2 / (1 + erf(a) + np.exp(-a * a) / (a * np.sqrt(np.pi))) / self.c

    def sent_to_the_wrong_side(self):
        """Share of the light that they mirror below the horizon, or refract above it."""
        u, v = np.polynomial.legendre.leggauss(PANEL)
        u, v = np.sin(np.pi * u / 2), v * np.pi / 2 * np.cos(np.pi * u / 2)  # dense at both ends
        edges = self.panels()
        psi = ((edges[:-1] + edges[1:])[:, None] / 2 + np.diff(edges)[:, None] / 2 * u).reshape(-1, 1)
        cm, sm = self.tilt(psi)
        w = (np.diff(edges)[:, None] / 2 * v).reshape(-1, 1) * self.alpha * (cm / np.cos(psi)) ** 2
        w *= sm * self.area(cm, sm)
        turns = np.arccos(np.clip((self.cuts(psi) - self.c * cm) / np.maximum(self.s * sm, 1e-300), -1, 1))
        ends = np.sort(np.concatenate([np.zeros_like(cm), *turns, np.full_like(cm, np.pi)], axis=1), axis=1)
        wrong, ratio = 0.0, self.ratio
        for low, high in zip(ends.T[:-1, :, None], ends.T[1:, :, None], strict=True):
            phi = (low + high) / 2 + (high - low) / 2 * u
            i_m = self.s * sm * np.cos(phi) + self.c * cm
            inner = np.sqrt(np.maximum(1 - ratio**2 * (1 - i_m**2), 0.0))
            rs, rp = (ratio * i_m - inner) / (ratio * i_m + inner), (i_m - ratio * inner) / (i_m + ratio * inner)
            f = np.where(inner > 0, (rs**2 + rp**2) / 2, 1.0)
            lost = f * (2 * i_m * cm < self.c) + (1 - f) * ((ratio * i_m - inner) * cm > ratio * self.c)
            wrong += np.sum(np.where(i_m > 0, lost * i_m, 0.0) * w * (high - low) * v)
        return wrong


@pytest.mark.parametrize("distribution", ["ggx", *thorough("beckmann")])
def test_all_light_is_accounted_for_where_only_the_light_is_masked(distribution):
    """Smith's G₁ of the light alone: R + T, and what visible facets send to the wrong side of the surface, are 1."""
    theta, sent, met = np.radians([0.0, 40.0, 75.0, 105.0, 140.0]), [], 0
    for alpha, eta in ((0.03, 1.5), (0.2, 1.5), (0.5, 1.5), (0.5, 0.7)):
        fields = jnp.asarray(alpha), jnp.asarray(alpha), jnp.asarray(eta), distribution, "separable"
        r = directional_albedo(ReflectionOnce(*fields), theta, tolerance=1e-7)
        t = directional_transmittance(RefractionOnce(*fields), theta, tolerance=1e-7)
        wrong = np.array([VisibleFacets(distribution, alpha, eta, a).sent_to_the_wrong_side() for a in theta])
        off, bound = np.abs(r.value + t.value + wrong - 1), r.bound + t.bound + 1e-7
        assert np.all(off <= np.maximum(bound, 1e-6))
        sent, met = [*sent, wrong.max()], met + np.count_nonzero(bound < 1e-6)
    assert sent[0] < sent[1] < sent[2] and sent[2] > 0.1  # little of narrow facets, much of wide ones
    assert met >= 10


def test_beta_function_to_the_digit():
    a, b = np.array([1.0, 1.02, 1.02, 1.5, 3, 10, 30, 2.3, 1.0001]), np.array([1, 7.9, 86, 20, 300, 12, 100, 1e8, 1e12])
    with mp.workdps(40):
        exact = [float(mp.log(mp.beta(mp.mpf(x), mp.mpf(y)))) for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(log_beta(a, b), exact, rtol=1e-14, atol=3e-15)
    np.testing.assert_array_equal(log_beta(a, b), log_beta(b, a))


def test_values_against_walters_formula_in_forty_digits():
    """From all sides, near straight through and at the horizon."""
    for cell in value_cells("rough_dielectric", "rough_dielectric(eta=1.5, alpha=0.3)", "float64", ("30°", "80°")):
        assert cell.verdict == "right", cell.detail


def test_no_interface_at_index_one():
    """Light then goes straight on, which no finite f holds."""
    wi, wo = from_spherical(0.4, 0.0), from_spherical(np.array([2.0, np.pi - 0.4]), np.pi)
    assert not np.any(evaluate(RoughDielectric(alpha=0.2, eta=1.0), wi, wo))


def test_reflectance_from_inside_to_the_digit():
    def exact(c, n):
        n = mp.mpf(n)
        g2 = 1 - n**2 * (1 - mp.mpf(c) ** 2)
        if g2 <= 0:
            return 1.0
        g = mp.sqrt(g2)
        return float((((g - n * c) / (g + n * c)) ** 2 + ((c - n * g) / (c + n * g)) ** 2) / 2)

    with mp.workdps(40):
        for n in (1.5, 0.7, 1.000001, 0.9999, 4.0):
            for c in (1.0, 0.9, 0.75, 0.5, 1e-3, 1e-9):
                assert float(fresnel_dielectric_inside(jnp.asarray(c), jnp.asarray(n))) == pytest.approx(
                    exact(c, n), rel=1e-12, abs=1e-30
                )


def transmittance_at_normal(alpha, n):
    """∫ D cosθ_d (1 − F) G₁ dω over the facets, the light along the normal of a GGX surface."""

    def share(angle):
        c, s = np.cos(angle), np.sin(angle)
        inner = np.sqrt(1 - s * s / n**2)
        reflected = ((c - n * inner) / (c + n * inner)) ** 2 / 2 + ((n * c - inner) / (n * c + inner)) ** 2 / 2
        z = 1 / n - (c / n - inner) * c
        masked = 2 * z / (z + np.sqrt(z * z + alpha**2 * (1 - z * z)))
        density = alpha**2 / (np.pi * (c * c * alpha**2 + s * s) ** 2)
        return density * c * (1 - reflected) * masked * 2 * np.pi * s

    return quad(share, 0, np.pi / 2, epsabs=1e-11, limit=500, points=[alpha, 10 * alpha])[0]


def test_dispersed_channels_are_integrated_each_where_it_goes():
    t = directional_transmittance(build("rough_dielectric(alpha=0.003, eta=[1.4, 1.8])"), 0.0, tolerance=1e-8)
    expected = [transmittance_at_normal(0.003, eta) for eta in (1.4, 1.8)]
    assert np.all(np.abs(t.value - expected) <= t.bound + 1e-10)


@pytest.mark.parametrize("theta", [135.0, *thorough(0.0, 80.0)])
def test_sampler_draws_with_its_density_into_both_hemispheres(theta):
    model = build("rough_dielectric(alpha_x=0.1, alpha_y=0.3, eta=1.5)")
    counts = count_and_expect(model, np.radians(theta), 40_000)
    assert p_value(counts) > 1e-4 and counts.not_finite == 0


def test_walters_fit_is_beckmanns():
    with pytest.raises(GonioError, match="beckmann"):
        build("rough_dielectric(alpha=0.1, eta=1.5, smith=walter)")
