"""Diffuse sheets: what they scatter between which sides, their shares, and sums with what only reflects."""

import jax
import numpy as np
import pytest

from gonio.data.subject import load_material
from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate, sampled_directions
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction, from_spherical

SUM = "lambert(rho=0.3) + lambert_transmission(tau=0.4)"
SIDES = [(0.4, 0.6), (0.4, 2.5), (2.7, 0.6), (2.7, 2.5)]
"""θi and θo: reflected, transmitted, transmitted from behind, reflected behind."""


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("lambert(rho=0.3)", (0.3, 0, 0, 0)),
        ("lambert_transmission(tau=0.4)", (0, 0.4, 0.4, 0)),
        (SUM, (0.3, 0.4, 0.4, 0)),
        ("thin_sheet(rho=0.3, tau=0.4)", (0.3, 0.4, 0.4, 0.3)),
        ("0.5 * thin_sheet(rho=0.3, tau=0.4, rho_behind=0.2)", (0.15, 0.2, 0.2, 0.1)),
    ],
)
def test_values_by_the_sides_of_light_and_detector(expression, expected):
    brdf = build(expression)
    theta_i, theta_o = np.array(SIDES).T
    f = evaluate(brdf, from_spherical(theta_i, 0.2), from_spherical(theta_o, 1.0))
    np.testing.assert_allclose(f, np.array(expected) / np.pi, rtol=1e-15)
    assert not np.any(evaluate(brdf, Direction(1.0, 0.0, 0.0), from_spherical(theta_o, 1.0)))


def test_shares_from_either_side():
    brdf = build("thin_sheet(rho=[0.3, 0.1], tau=0.4, rho_behind=0.2)")
    theta = np.radians([0.0, 89.0, 91.0, 180.0])
    reflected, transmitted = directional_albedo(brdf, theta), directional_transmittance(brdf, theta)
    np.testing.assert_allclose(reflected.value, [[0.3, 0.1], [0.3, 0.1], [0.2, 0.2], [0.2, 0.2]], atol=1e-12)
    np.testing.assert_allclose(transmitted.value, 0.4, atol=1e-12)
    only = directional_transmittance(build("lambert(rho=[0.1, 0.2])"), theta)
    assert only.value.shape == (4, 2) and not only.value.any() and not only.bound.any()


def test_a_sum_lit_from_behind_draws_from_what_transmits():
    brdf, u = build(SUM), np.random.default_rng(0).random((2, 4000))
    for theta, front in ((0.4, 0.5), (2.7, 1.0)):
        wi = from_spherical(theta, 0.0)
        w = np.stack(sampled_directions(brdf, wi, *u))
        kept = np.isfinite(w[2])
        assert np.mean(w[2][kept] > 0) == pytest.approx(front, abs=0.03)
        assert np.mean(kept) == pytest.approx(1.0 if theta < 1.5 else 0.5, abs=0.03)
        density = jax.vmap(lambda wo, wi=wi: brdf.pdf(wi, wo))(Direction(*np.nan_to_num(w)))
        np.testing.assert_allclose(density[kept], np.abs(w[2][kept]) / (2 * np.pi), rtol=1e-12)


def test_material_takes_light_from_behind_where_it_transmits():
    sheet = load_material(SUM)
    np.testing.assert_allclose(sheet.transmittance([20, 160], degrees=True).value, 0.4, atol=1e-10)
    assert float(sheet.f(160, 0, 20, 0, degrees=True)[0]) == pytest.approx(0.4 / np.pi)
    with pytest.raises(GonioError, match="horizon"):
        sheet.albedo(90, degrees=True)
    with pytest.raises(GonioError, match="angle 200"):
        sheet.f(200, 0, 20, 0, degrees=True)


def test_what_gains_says_so_and_coats_stand_over_no_sheet():
    assert "energy" in build("thin_sheet(rho=0.5, tau=0.4, rho_behind=0.7)").violates
    assert not build("thin_sheet(rho=0.5, tau=0.5)").violates
    with pytest.raises(GonioError, match="only reflects"):
        build("coat(base=lambert_transmission(tau=0.4), alpha=0.1, eta=1.5)")
