"""Colours of lit spheres: published pairs of CIEDE2000, white, and readings as pixels."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.table import Channels
from gonio.fitting.problem.readings import Readings
from gonio.fitting.residuals.colour_difference import ciede2000, colour_matrix, observer, sphere_difference, to_lab

# Sharma, Wu & Dalal [2005], table 1: the two colours and their difference.
PAIRS = np.array(
    [
        [50, 2.6772, -79.7751, 50, 0, -82.7485, 2.0425],
        [50, -1, 2, 50, 0, 0, 2.3669],
        [50, 2.49, -0.001, 50, -2.49, 0.0009, 7.1792],
        [50, 2.5, 0, 73, 25, -18, 27.1492],
        [50, 2.5, 0, 61, -5, 29, 22.8977],
        [50, 2.5, 0, 56, -27, -3, 31.9030],
        [50, 2.5, 0, 58, 24, 15, 19.4535],
        [60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644],
        [90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441],
        [6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377],
        [2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082],
    ]
)


def test_published_pairs():
    np.testing.assert_allclose(ciede2000(PAIRS[:, :3], PAIRS[:, 3:6]), PAIRS[:, 6], atol=6e-5)
    np.testing.assert_allclose(ciede2000(PAIRS[:, 3:6], PAIRS[:, :3]), PAIRS[:, 6], atol=6e-5)


def test_white_is_white():
    rgb = colour_matrix(Channels.rgb())
    np.testing.assert_allclose(rgb.sum(1), [0.9505, 1.0, 1.089], atol=1e-3)
    np.testing.assert_allclose(to_lab(rgb.sum(1)[None], rgb.sum(1)), [[100, 0, 0]], atol=1e-9)
    assert colour_matrix(Channels.of_wavelengths([532.0, 633.0])) is None and colour_matrix(Channels.grey()) is None


def test_what_lies_beyond_the_visible_has_no_part_in_a_colour():
    visible = [450.0, 500.0, 550.0, 600.0, 650.0]
    beside = colour_matrix(Channels.of_wavelengths([355.0, *visible, 1064.0]))
    np.testing.assert_array_equal(beside[:, 1:-1], colour_matrix(Channels.of_wavelengths(visible)))
    assert not beside[:, [0, -1]].any()


def test_the_observer_is_that_of_the_cie():
    """Equal energy has equal tristimulus values, 106.857 nm at 1 nm [CIE 015]; 555 nm and all peaks as tabulated."""
    waves = np.arange(360.0, 831.0)
    np.testing.assert_allclose(observer(waves).sum(1), 106.86, rtol=4e-4)
    np.testing.assert_array_equal(observer(np.array([555.0, 599.0, 1000.0]))[1, [0, 2]], [1.0, 0.0])
    assert [waves[k] for k in observer(waves).argmax(1)] == [600, 555, 445]
    spectral = colour_matrix(Channels.of_wavelengths(waves))
    np.testing.assert_allclose(spectral.sum(1), 1, atol=4e-4)


def test_a_sphere_one_percent_brighter():
    """L* of a grey diffuser lit from a phase angle g: the mean over the sphere's pixels, by direct integration."""
    theta = np.radians(np.arange(0, 90, 2.5))
    layout = layouts.isotropic(theta, theta, np.radians(np.arange(0, 360, 7.5)))
    wi, wo = layout.directions()
    f = np.full((layout.size, 3), 0.5 / np.pi)
    readings = Readings(wi, wo, f, np.zeros_like(f), np.repeat((np.minimum(wi.z, wo.z) > 0)[:, None], 3, 1))
    difference = sphere_difference(Channels.rgb(), readings, 1.1 * f, layout)
    expected, weight = 0.0, 0.0
    x, y = (a.ravel() for a in np.meshgrid(*(np.linspace(-1, 1, 401),) * 2))
    up = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    for g in np.radians(np.arange(30.5, 60, 1)):
        cos_i = x * np.sin(g) + up * np.cos(g)
        lit = 0.5 * cos_i[(cos_i > 0) & (up > 0)]
        l1, l2 = (116 * np.cbrt(v) - 16 for v in (lit, 1.1 * lit))
        dark = lit < 0.01  # Lab is linear there
        middle = (l1 + l2) / 2
        scale = 1 + 0.015 * (middle - 50) ** 2 / np.sqrt(20 + (middle - 50) ** 2)
        # Spheres of all phase angles are as many as pairs of directions there: in proportion to sin g.
        expected += np.sin(g) * np.sum(((l2 - l1) / scale)[~dark])
        weight += np.sin(g) * np.count_nonzero(~dark)
    assert difference["name"] == "CIEDE2000" and difference["pixels"] > 1000
    assert difference["mean"] == pytest.approx(expected / weight, rel=0.04)
    assert sphere_difference(Channels.rgb(), readings, f, layout)["mean"] == 0.0
