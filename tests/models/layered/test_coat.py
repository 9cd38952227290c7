"""A rough coat over a base: its albedo by another rule, energy, and Mitsuba's plastics and dielectrics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.metrology.quantities import quantities
from gonio.models.albedo import directional_albedo
from gonio.models.diffuse.lambert import Lambert
from gonio.models.diffuse.white_standard import WhiteStandard
from gonio.models.empirical.phong import Phong
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.fresnel import fresnel_average
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.layered.coat import Coat, UnderCoat, refracted
from gonio.models.layered.kelemen import KelemenLobe
from gonio.models.microfacet import albedo_tables as albedo_table
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.microfacet.ggx import GGX
from support import helpers
from support.check_tables import property_of

THETA = np.radians([0.0, 45.0, 80.0, 89.9])


def test_albedo_of_the_coat_alone():
    """The table against the integral of GGX by its own lobe map, which shares no node with it."""

    @jax.jit
    def tabulated(alpha, eta, mu):
        series = albedo_table.coat_series(alpha, eta)
        return jax.vmap(lambda m: albedo_table.tabulated("coat", series, m, alpha))(mu)

    for alpha, eta in ((1e-4, 1.01), (1e-4, 4.0), (0.02, 1.2), (0.3, 1.5), (1.0, 2.7)):
        found = np.asarray(tabulated(alpha, eta, np.cos(THETA)))
        albedo = directional_albedo(GGX(alpha=alpha, eta=eta), THETA)
        assert np.all(np.abs(found - albedo.value) < 6e-8 + albedo.bound), (alpha, eta)


@pytest.mark.parametrize("base", [WhiteStandard(), Phong(n=200.0)], ids=["white", "phong"])
def test_conserves_what_its_base_conserves(base):
    for alpha, eta in ((1e-4, 1.01), (0.1, 1.5), (1.0, 3.0)):
        albedo = directional_albedo(Coat(base, alpha=alpha, eta=eta), THETA, tolerance=1e-7)
        assert np.all(albedo.value + albedo.bound < 1) and albedo.bound.max() < 1e-6


NARROW = {
    "kelemen": KelemenLobe(jnp.asarray(0.001), jnp.asarray(1.0)),
    "metal": build("principled(base_color=1, metallic=1, roughness=0.03)").terms()[1],
    "retro": build("retro(alpha=0.001)"),
    "polished": build(f"harvey_shack(b0={1e8 / np.pi}, l=0.0001, s=-4)"),
    "below another coat": UnderCoat(GGX(alpha=0.001), jnp.asarray(0.0001), jnp.asarray(1.01)),
}
"""Lobes too narrow to be met by chance, which reflect everything."""


@pytest.mark.parametrize("name", NARROW)
def test_a_narrow_lobe_below_is_not_stepped_over(name):
    """A mirror below sends T² back through the coat, whatever law makes it narrow."""
    theta = np.radians([0.0, 45.0])
    passed = 1 - directional_albedo(GGX(alpha=0.1, eta=1.5), theta, tolerance=1e-4).value
    below = UnderCoat(NARROW[name], jnp.asarray(0.1), jnp.asarray(1.5))
    albedo = directional_albedo(below, theta, tolerance=1e-4)
    np.testing.assert_allclose(albedo.value, passed**2, atol=2e-3)
    assert albedo.bound.max() < 1e-3


def test_what_leaves_through_a_smooth_coat():
    """White Lambertian under η = 1.5: F + T(μ) (1 − F_avg)/η² for a smooth coat, the étendue that leaves."""
    albedo = directional_albedo(Coat(Lambert(rho=1.0), alpha=1e-4, eta=1.5), [0.0], tolerance=1e-7).value[0]
    leaving = (1 - float(fresnel_average(None, jnp.asarray(1.5), None))) / 1.5**2
    assert albedo == pytest.approx(0.04 + 0.96 * leaving, abs=1e-6)
    assert albedo == pytest.approx(0.43, abs=0.005)  # the number in the sentence of what it loses


def test_refraction_keeps_the_etendue():
    """sinθ = η sinθ′, and μ dω = η² μ′ dω′: the Jacobian of (x, y) is 1/η²."""
    w = Direction(jnp.asarray(0.6), jnp.asarray(0.3), jnp.sqrt(jnp.asarray(0.55)))
    inside = refracted(w, jnp.asarray(1.5))
    assert float(inside.x**2 + inside.y**2 + inside.z**2) == pytest.approx(1, abs=1e-15)
    assert float(inside.x) == pytest.approx(0.4) and float(inside.y) == pytest.approx(0.2)


def test_reciprocal_to_the_last_bit():
    rng = np.random.default_rng(2)
    v = rng.normal(size=(2, 3, 300))
    v[:, 2] = np.abs(v[:, 2])
    wi, wo = (Direction(*(c / np.linalg.norm(c, axis=0))) for c in v)
    model = UnderCoat(Lambert(rho=[0.2, 0.9]), jnp.asarray(0.3), jnp.asarray(1.5))
    assert np.array_equal(evaluate(model, wi, wo), evaluate(model, wo, wi))


def test_mitsuba_smooth_plastic_on_file():
    """Its diffuse part is 2.480208 × ours: it adds what bounces inside, 1/(1 − F_int), F_int the average from within.

    2.480208 is by Mitsuba's polynomial, F_int = 0.59681; the integral gives 0.59635. Our least width, 1e-4, is not
    smooth: T differs by some 1e-7/μ², so that cosines below 0.1 are left out.
    """
    for _, v, wi, wo, expected, _ in helpers.mitsuba("plastic"):
        rho = np.asarray(v["diffuse_reflectance"]["value"])
        keep = (wi.z > 0.1) & (wo.z > 0.1)
        f = evaluate(UnderCoat(Lambert(rho=rho), jnp.asarray(1e-4), jnp.asarray(v["int_ior"])), wi, wo)
        inside = float(fresnel_average(None, jnp.asarray(1 / v["int_ior"]), None))
        found = np.asarray(f) * wo.z[:, None]
        np.testing.assert_allclose(2.480208 * found[keep], expected[keep], rtol=2e-5)
        assert 1 / (1 - inside) == pytest.approx(2.480208, rel=1.2e-3)


def test_mitsuba_rough_dielectrics_on_file():
    """The reflected part of rough dielectrics, float32: separable Smith, Beckmann's G by the rational fit."""
    seen = 0
    for name, v, wi, wo, expected, above in helpers.mitsuba("roughdielectric"):
        ggx = v["distribution"] == "ggx"
        widths = {"alpha": v["alpha"]} if "alpha" in v else {"alpha_x": v["alpha_u"], "alpha_y": v["alpha_v"]}
        model = (GGX if ggx else Beckmann)(**widths, eta=v["int_ior"], smith="separable" if ggx else "walter")
        found = np.asarray(evaluate(model, wi, wo)) * wo.z
        kept = above & (expected[:, 0] > (0 if ggx else 1e-19))
        np.testing.assert_allclose(found[kept], expected[kept, 0], rtol=1e-4, err_msg=name)
        seen += 1
    assert seen >= 4


def test_total_reflection_is_a_mask():
    """A Lambertian base sends sin²θ = u2 upwards: beyond 1/η² nothing leaves, and the density adds up to what does."""
    brdf = build("coat(base=lambert(rho=1), alpha=0.2, eta=1.5)").terms()[1]
    u2 = np.linspace(0.01, 0.99, 99)
    wo, leaves = jax.vmap(lambda v: brdf.sample(Direction(0.0, 0.0, 1.0), 0.3, v))(jnp.asarray(u2))
    np.testing.assert_array_equal(leaves, u2 < 1 / 1.5**2)
    assert (np.asarray(wo.z)[np.asarray(leaves)] > 0).all()


@pytest.mark.thorough
def test_what_a_polished_base_mirrors_leaves_a_coat_but_for_what_the_coat_reflects():
    """T(μ)² of the base's image at the refracted angle; without the coat's reflection the whole of it."""
    base = "rayleigh_rice(wavelength=0.6328, eta=4.05, k=0.05, a=0.001, b=20, c=2)"
    silicon, coat, theta = build(base), f"coat(base={base}, alpha=0.1, eta=1.5)", 0.8
    wi, inside = (from_spherical(jnp.asarray(t), jnp.zeros(())) for t in (theta, np.arcsin(np.sin(theta) / 1.5)))
    passed = 1 - directional_albedo(build("ggx(alpha=0.1, eta=1.5)"), theta).value
    coated = build(coat).mirror_reflectance(wi)
    np.testing.assert_allclose(coated, passed**2 * silicon.mirror_reflectance(inside), rtol=1e-6)
    np.testing.assert_allclose((0.5 * build(coat)).mirror_reflectance(wi), 0.5 * coated)
    sent = build(f"transmitted(base={coat})").mirror_reflectance(wi._replace(z=-wi.z))
    np.testing.assert_allclose(sent, coated)
    assert build("coat(base=lambert(rho=1), alpha=0.1, eta=1.5)").mirror_reflectance(wi) == 0
    energy = property_of("energy", coat)
    assert energy.verdict == "pass" and "The specular share, no part of f, is counted" in energy.detail
    named = {(q.name, q.place): q.value for q in quantities(coat, only=("scatter",)).quantities}
    assert named["specular reflectance", "θi 0°"] == pytest.approx(
        float(build(coat).mirror_reflectance(from_spherical(0.0, 0.0)))
    )
