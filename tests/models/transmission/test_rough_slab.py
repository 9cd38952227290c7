"""A sheet with rough sides beside a flat one, and beside rays that bounce between two rough faces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from gonio.models.transmission.sheet_balance import (
    TERMS,
    Faces,
    balance_and_slopes_of_values,
    balance_of_values,
    basis_of,
    grazing_scale,
    sheet_light,
    stretched,
)
from support.marks import thorough
from support.rough_faces import Sheet, fresnel
from support.rough_faces import sheet_light as light_of_rays

RAYS = 15_000


def reflected_and_passed(sheet, theta):
    return tuple(
        np.ravel(integral(sheet, theta, 0.0, 1e-5).value)
        for integral in (directional_albedo, directional_transmittance)
    )


@pytest.mark.parametrize(("eta", "most"), [(1.01, 0.002), *thorough((1.05, 0.001), (1.5, 0.0004))])
@pytest.mark.parametrize("alpha", [0.1, *thorough(0.3)])
def test_a_clear_sheet_gains_hardly_anything(alpha, eta, most):
    theta = np.radians([0, 20, 40, 50, 60, 66, 72, 75, 85])
    total = sum(reflected_and_passed(build(f"rough_slab(alpha={alpha}, eta={eta})"), theta))
    assert np.max(total) <= 1 + most
    assert total[0] > 0.98  # nor does it lose what it passes straight on


def test_narrow_lobes_share_the_light_as_a_flat_sheet_does():
    """All bounces of a plate: R = F + F(1−F)²k²/(1−F²k²), T = (1−F)²k/(1−F²k²), k what the inside passes once."""
    cosine = np.cos(theta := np.radians([0.0, 30.0, 60.0]))
    reflected, _ = fresnel(cosine, 1.5)
    once = 0.8 ** (1 / np.sqrt(1 - (1 - cosine**2) / 1.5**2))
    passed = (1 - reflected) ** 2 * once / (1 - (reflected * once) ** 2)
    r, t = reflected_and_passed(build("rough_slab(alpha=0.003, eta=1.5, clear=0.8)"), theta)
    np.testing.assert_allclose(t, passed, rtol=2e-4)
    np.testing.assert_allclose(r, reflected + passed * reflected * once, rtol=2e-3)


@pytest.mark.parametrize(
    ("sheet", "theta", "within"),
    [
        (Sheet(0.05, 0.1, 1.5, 0.8), 30, 0.003),
        (Sheet(0.35, 0.2, 1.8, 0.9), 75, 0.02),
        *thorough(
            (Sheet(0.1, 0.1, 1.5), 0, 0.003), (Sheet(0.2, 0.2, 1.5), 30, 0.005), (Sheet(0.1, 0.1, 1.5), 60, 0.008)
        ),
    ],
)
def test_light_is_that_of_rays_between_two_rough_faces(sheet, theta, within):
    """R and T, and f about both peaks, near the normal."""
    model = build("rough_slab(alpha={}, alpha_behind={}, eta={}, clear={})".format(*sheet))
    angle = np.radians(theta)
    degrees = np.array([theta, theta + 6.0]) if theta < 60 else np.array([])
    views = [(-np.sin(v), 0.0, side * np.cos(v)) for v in np.radians(degrees) for side in (1, -1)]
    r, t, f = light_of_rays(sheet, angle, RAYS, 7, views)
    np.testing.assert_allclose([r, t], np.ravel(reflected_and_passed(model, angle)), atol=within)
    if theta < 60:
        wi = Direction(np.sin(angle), 0.0, np.cos(angle))
        wo = Direction(*(np.array(c) for c in zip(*views, strict=True)))
        ours = np.ravel(evaluate(model, wi, wo))
        np.testing.assert_allclose(ours, f, rtol=0.06)


def test_a_nearly_clear_sheet_is_nearly_a_clear_one():
    """Of grazing light a flat sheet, all bounces summed, loses much as soon as it absorbs; rough faces do not."""
    clear, nearly = (
        [np.asarray(a) for a in balance_of_values(*(np.asarray(v) for v in (0.15, 0.15, 1.5, clear)))]
        for clear in (1.0, 1.0 - 1e-4)
    )
    for a, b in zip(clear, nearly, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3)


def test_a_series_stretched_is_its_slope_by_the_scale():
    """Σ cₖTₖ(x) at one cosine, x by the scale: its slope by ln(scale/(1 + scale)) is a series of one term more."""
    series, scale, cosine = np.random.default_rng(0).normal(size=TERMS + 1), 0.3, np.linspace(0.01, 1, 9)
    series[-1], step = 0.0, 1e-6
    ends = [series @ np.asarray(basis_of(cosine, scale + d)) for d in (-step, step)]
    slope = (ends[1] - ends[0]) / (2 * step) * scale * (1 + scale)
    np.testing.assert_allclose(stretched() @ series @ np.asarray(basis_of(cosine, scale)), slope, rtol=1e-6, atol=1e-7)


@pytest.mark.thorough
def test_slopes_are_those_of_what_is_computed():
    """At fixed cosines, of all three series: those of fits that leave structure end where their gradient is 0."""
    values, cosine = np.array([0.2, 0.1, 1.5, 0.9]), np.linspace(0.02, 1, 30)

    def at(balance, values):
        basis = np.asarray(basis_of(cosine, grazing_scale(*values[:3])))
        return np.stack([np.asarray(a) @ basis for a in balance[:3]])

    _, slopes = balance_and_slopes_of_values(*(np.asarray(v) for v in values))
    for k in range(4):
        ends = [values + d * np.eye(4)[k] for d in (-1e-6, 1e-6)]
        low, high = (at(balance_of_values(*(np.asarray(v) for v in end)), end) for end in ends)
        ours = at([np.asarray(a)[k] for a in slopes], values)
        np.testing.assert_allclose(ours, (high - low) / 2e-6, atol=2e-4)


def test_one_number_may_have_channels_where_others_have_none():
    """As in a fit that holds eta, or that frees the transmittance of each channel."""

    def slope(*values):
        return jax.jvp(lambda *v: sheet_light(Faces(*v)), values, values)

    for shapes in (((), (), (1,), ()), ((3,), (), (), (3,))):
        series, slopes = jax.eval_shape(slope, *(jnp.ones(s) for s in shapes))
        assert jax.tree.map(jnp.shape, series) == jax.tree.map(jnp.shape, slopes)
