"""A sheet with rough sides beside a flat one, and beside rays that bounce between two rough faces."""

import numpy as np
import pytest

from gonio.models.albedo import directional_albedo, directional_transmittance
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.directions import Direction
from support.rough_faces import Sheet, fresnel, sheet_light

RAYS = 15_000


def reflected_and_passed(sheet, theta):
    return tuple(
        np.ravel(integral(sheet, theta, 0.0, 1e-5).value)
        for integral in (directional_albedo, directional_transmittance)
    )


@pytest.mark.parametrize(("eta", "most"), [(1.01, 0.002), (1.05, 0.001), (1.5, 0.0004)])
def test_a_clear_sheet_gains_hardly_anything(eta, most):
    theta = np.radians([0, 20, 40, 50, 60, 66, 72, 75, 85])
    for alpha in (0.1, 0.3):
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
        (Sheet(0.1, 0.1, 1.5), 0, 0.003),
        (Sheet(0.05, 0.1, 1.5, 0.8), 30, 0.003),
        (Sheet(0.2, 0.2, 1.5), 30, 0.005),
        (Sheet(0.1, 0.1, 1.5), 60, 0.008),
        (Sheet(0.35, 0.2, 1.8, 0.9), 75, 0.02),
    ],
)
def test_light_is_that_of_rays_between_two_rough_faces(sheet, theta, within):
    """R and T, and f about both peaks, near the normal."""
    model = build("rough_slab(alpha={}, alpha_behind={}, eta={}, clear={})".format(*sheet))
    angle = np.radians(theta)
    degrees = np.array([theta, theta + 6.0]) if theta < 60 else np.array([])
    views = [(-np.sin(v), 0.0, side * np.cos(v)) for v in np.radians(degrees) for side in (1, -1)]
    r, t, f = sheet_light(sheet, angle, RAYS, 7, views)
    np.testing.assert_allclose([r, t], np.ravel(reflected_and_passed(model, angle)), atol=within)
    if theta < 60:
        wi = Direction(np.sin(angle), 0.0, np.cos(angle))
        wo = Direction(*(np.array(c) for c in zip(*views, strict=True)))
        ours = np.ravel(evaluate(model, wi, wo))
        np.testing.assert_allclose(ours, f, rtol=0.06)
