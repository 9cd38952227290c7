"""What readings tell of a lobe's light: nothing with its peak and foot alone, then as much as they agree with it."""

import numpy as np
import pytest

from gonio.checks.table.albedos.on_grid import hemisphere_grid
from gonio.checks.table.albedos.untested_lobes import FACTOR, LobeReadings, lobe_tests, shape_numbers, values_at
from gonio.data import layouts
from gonio.models.expression.builder import build
from support.check_tables import degrees

NARROW = build("lambert(rho=0.3) + 0.5 * beckmann(alpha=0.02)")
LIGHT = np.radians([[20.0, 0.0], [60.0, 0.0]])


def read(levels, brightness=1.0, noise=0.0, light=0):
    """Readings so many e-folds below the peak, where the lobe is as much brighter; at 20°, or at another light."""
    tilt = 0.02 * np.sqrt(np.array(levels))
    theta_o = LIGHT[light, 0] - 2 * tilt
    angles = np.stack([np.full(tilt.size, LIGHT[light, 0]), 0 * tilt, theta_o, np.full(tilt.size, np.pi)], -1)
    lobe = values_at(NARROW.terms()[1], angles)
    return LobeReadings(angles, values_at(NARROW, angles) + (brightness - 1) * lobe, noise * lobe)


def test_of(readings, resolved=False, nodes=None):
    tests = lobe_tests(NARROW, LIGHT, readings, lambda lobe: np.full((2, 1), resolved or lobe.number == 0), nodes)
    return tests[0] if tests else None


test_of.__test__ = False


def test_a_third_level_tests_a_lobe_and_then_its_light_is_as_sure_as_the_readings():
    peak_and_foot = test_of(read([0.0, 0.1, 3.4]))
    light = peak_and_foot.lobe.light(1)
    np.testing.assert_allclose(peak_and_foot.off, FACTOR * light)
    assert not peak_and_foot.tested.any()
    tail = test_of(read([0.0, 7.5, 8.6]))  # two levels where the lobe has next to none of its light
    np.testing.assert_allclose(tail.off, FACTOR * light)
    tested = test_of(read([0.0, 1.3, 2.4]))
    assert np.max(tested.off / light) < 1e-9
    assert tested.tested.tolist() == [True, False]  # at 60° nothing on the lobe was read
    brighter = test_of(read([0.0, 1.3, 2.4], brightness=1.001))
    np.testing.assert_allclose(brighter.off / light, 1e-3, rtol=0.02)
    another = test_of(read([0.0, 1.3, 2.4], brightness=1.3))
    assert np.min(another.off / light) > 1
    noisy = test_of(read([0.0, 1.3, 2.4], brightness=1.001, noise=1e-3))
    assert np.max(noisy.off / light) < 1e-9
    np.testing.assert_allclose(noisy.by_readings / light, 4e-3, rtol=0.05)
    assert test_of(read([0.0]), resolved=True) is None


def test_where_an_incidence_was_read_closely_its_own_readings_tell_of_its_lobe():
    elsewhere = read([0.0, 1.3, 2.4], brightness=1.5, light=1)
    few = test_of(read([0.0, 1.3, 2.4]).joined(elsewhere))
    assert np.min(few.off / few.lobe.light(1)) > 0.5
    close = read(np.arange(0, 9, 0.2), brightness=1.001)
    many = test_of(close.joined(elsewhere))
    np.testing.assert_allclose(many.off[0] / many.lobe.light(1)[0], 1e-3, rtol=0.1)
    assert many.off[1] / many.lobe.light(1)[1] > 0.5

    def exact(lobe, k):
        """Nodes that miss nothing of a lobe."""
        samples = lobe.samples[k]
        return samples.f, samples.light[:, 0] / np.maximum(samples.f[:, 0], 1e-300)

    carried = test_of(close.joined(elsewhere), nodes=exact)
    assert carried.off[0] < 1e-3 * many.off[0]
    np.testing.assert_allclose(carried.by_readings, many.by_readings)


@pytest.mark.parametrize(
    ("lobe", "numbers"),
    [
        ("lambert(rho=0.1)", 0),
        ("0.3 * ggx(alpha=0.1)", 1),
        ("2 * gtr(alpha=0.1, gamma=2)", 2),
        ("ggx(alpha_x=0.1, alpha_y=0.2)", 2),
    ],
)
def test_a_family_has_as_many_shape_numbers(lobe, numbers):
    assert shape_numbers(build(lobe).terms()[0]) == numbers


def test_a_node_that_has_the_light_of_a_lobe_by_chance_does_not_resolve_it():
    grid = hemisphere_grid(layouts.isotropic([0.0], degrees(0, 89.9, 5), degrees(0, 360, 10)))
    spike = np.zeros((*grid.weights.shape[:2], 1))
    spike[4, 6] = 1.0
    albedo = np.sum(grid.weights * spike, axis=(0, 1))
    assert not grid.resolves(spike, albedo).any()
    assert grid.resolves(np.ones_like(spike), np.array([np.pi])).all()
