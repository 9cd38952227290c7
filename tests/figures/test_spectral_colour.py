"""Colour of spectra: white is white, lights of one wavelength lie where the observer has them, gold is yellow."""

import numpy as np
import pytest

from gonio.data.table import Channels
from gonio.figures.spectral_colour import D65, channel_colour
from gonio.fitting.residuals.colour_difference import LINEAR_SRGB, observer


def of(wavelengths):
    return channel_colour(Channels.of_wavelengths(wavelengths))


@pytest.mark.parametrize("step", [1.0, 5.0, 10.0, 40.0])
def test_equal_reflectances_are_grey(step):
    matrix = of(np.arange(380, 781, step)).matrix
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-3)


def test_the_white_of_the_light_is_that_of_srgb():
    """CIE 15: x 0.31272, y 0.32903 of D65 by the 2° observer."""
    nodes = np.arange(380.0, 781.0, 5.0)
    power = np.interp(nodes, np.arange(380.0, 781.0, 10.0), D65)
    xyz = observer(nodes) @ power
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), [0.31272, 0.32903], atol=2e-5)


def test_a_band_has_the_colour_that_direct_integration_gives():
    nodes = np.arange(380.0, 781.0, 1.0)
    reflectance = 0.1 + 0.8 * np.exp(-(((nodes - 600) / 40) ** 2))
    power = np.interp(nodes, np.arange(380.0, 781.0, 10.0), D65)
    xyz = observer(nodes) @ (power * reflectance) / (observer(nodes)[1] @ power)
    for step in (1, 5, 10):
        srgb = of(nodes[::step]).matrix @ reflectance[::step]
        np.testing.assert_allclose(srgb, np.linalg.inv(LINEAR_SRGB) @ xyz, atol=3e-3 * step)


def test_order_of_wavelengths_does_not_matter():
    nodes = np.arange(400, 701, 30.0)
    np.testing.assert_allclose(of(nodes[::-1]).matrix[:, ::-1], of(nodes).matrix)


def test_gold_is_yellow():
    wavelengths = [413.3, 450.9, 495.9, 548.6, 616.8, 659.5, 704.5]  # reflectances at normal incidence [Johnson 1972]
    red, green, blue = of(wavelengths).matrix @ [0.39, 0.39, 0.45, 0.82, 0.95, 0.97, 0.97]
    assert red > green > 1.5 * blue


def test_what_is_taken_for_granted_is_said():
    assert "D65" in of(np.arange(380, 781, 10.0)).words and "constant" not in of(np.arange(380, 781, 10.0)).words
    words = of([450.0, 550.0, 650.0]).words
    assert "constant below 450 nm and above 650 nm" in words and "%" in words


@pytest.mark.parametrize("wavelengths", [[633.0], [450.0, 650.0], [600.0, 650.0, 700.0], [1064.0, 1550.0, 1600.0]])
def test_too_few_wavelengths_have_no_colour(wavelengths):
    found = of(wavelengths)
    assert found.matrix is None and "tell no colour" in found.words


def test_channels_without_wavelengths():
    assert channel_colour(Channels.rgb()).matrix is not None
    assert channel_colour(Channels.grey()).matrix is None


def test_what_lies_far_beyond_the_visible_has_no_part_in_a_colour():
    visible = [450.0, 550.0, 640.0]
    alone, beside = of(visible), of([*visible, 1064.0])
    np.testing.assert_array_equal(beside.matrix[:, :3], alone.matrix)
    assert beside.words == alone.words and not beside.matrix[:, 3].any()


def test_several_channels_of_one_wavelength_have_no_colour():
    two = Channels(("a", "b", "c", "d"), (450.0, 550.0, 550.0, 640.0))
    assert channel_colour(two).matrix is None
