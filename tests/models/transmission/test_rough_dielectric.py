"""A rough interface: other people's shares and values, the energy of its formula, limits of its index, its samplers."""

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate, evaluate_in_blocks
from gonio.models.expression.builder import build
from gonio.models.fresnel import fresnel_dielectric_inside
from gonio.models.geometry.directions import from_spherical
from gonio.models.log_beta import log_beta
from gonio.models.transmission.rough_dielectric import RoughDielectric, RoughReflection, RoughRefraction
from gonio.stability.samplers import count_and_expect, p_value
from gonio.stability.values_and_gradients import value_cells
from support import helpers

pytestmark = pytest.mark.quick_compilation


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
    formula in double precision, at directions made units in double precision, is ours to 1e-12, while its rounding, and
    that of the directions, moves these values by as much (tests/benchmarks/models/rough_dielectric_precision.py).
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


def test_all_light_is_accounted_for_where_only_the_light_is_masked():
    """Smith's G₁ of the light alone: R + T = 1, but for what tilted facets send to the wrong side, 1e-9 here."""
    theta = np.radians([0.0, 40.0, 140.0])
    for alpha, eta in ((0.01, 1.5), (0.03, 0.7), (0.03, 1.01)):
        fields = jnp.asarray(alpha), jnp.asarray(alpha), jnp.asarray(eta), "beckmann", "separable"
        r = directional_albedo(ReflectionOnce(*fields), theta, tolerance=1e-7)
        t = directional_transmittance(RefractionOnce(*fields), theta, tolerance=1e-7)
        np.testing.assert_allclose(r.value + t.value, 1.0, atol=1e-6)


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


@pytest.mark.parametrize("theta", [0.0, 80.0, 135.0])
def test_sampler_draws_with_its_density_into_both_hemispheres(theta):
    model = build("rough_dielectric(alpha_x=0.1, alpha_y=0.3, eta=1.5)")
    counts = count_and_expect(model, np.radians(theta), 40_000)
    assert p_value(counts) > 1e-4 and counts.not_finite == 0


def test_walters_fit_is_beckmanns():
    with pytest.raises(GonioError, match="beckmann"):
        build("rough_dielectric(alpha=0.1, eta=1.5, smith=walter)")
