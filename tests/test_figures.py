"""Pictures: projections, scales and labels that are right, and SVG that can stand on a page with others."""

import re

import numpy as np
import pytest

from gonio.figures.albedo import AlbedoCurve, albedo_figure
from gonio.figures.hemisphere import colour_range, disc_points, hemisphere_map, on_disc
from gonio.figures.lobes import Curve, in_plane, polar, value_range
from gonio.figures.residuals import median_grid, residual_histogram, residual_map
from gonio.figures.style import colour_of, shades
from gonio.figures.ticks import decades_between, sr_label


def test_equal_areas_of_a_map_are_equal_solid_angles():
    inside, theta, phi = disc_points(401)
    band = (theta > np.radians(30)) & (theta < np.radians(60)) & (phi < np.pi)
    share = band.sum() / inside.sum()
    assert share == pytest.approx((np.cos(np.radians(30)) - np.cos(np.radians(60))) / 2, rel=0.01)


def test_points_go_where_their_pixels_are():
    inside, theta, phi = disc_points()
    x, y = on_disc(theta, phi)
    rows, columns = np.nonzero(inside)
    side = inside.shape[0]
    np.testing.assert_allclose((x + 1) * side / 2 - 0.5, columns, atol=1e-9)
    np.testing.assert_allclose((1 - y) * side / 2 - 0.5, rows, atol=1e-9)


def test_light_is_left_and_mirror_right():
    assert on_disc(np.array(0.7), np.array(0.0))[0] < 0 < on_disc(np.array(0.7), np.array(np.pi))[0]


@pytest.mark.parametrize(
    ("value", "text"), [(0, "0"), (0.5, "0.5"), (1500, "1500"), (1e-4, "10⁻⁴"), (2e5, "2·10⁵"), (-0.03, "−0.03")]
)
def test_values_are_written_as_people_write_them(value, text):
    assert sr_label(value) == text


def test_scales_hold_the_data():
    assert decades_between(0.02, 300) == [0.01, 0.1, 1, 10, 100, 1000]
    low, high = colour_range(np.array([-1.0, 0.0, np.nan, 1e-9, 2.0]))
    assert (low, high) == (2e-6, 2.0)
    nothing = Curve(np.array([0.0]), np.array([-1.0]), "a", "#000000")
    assert value_range([nothing]) == (0.1, 1.0)


def test_no_two_subjects_look_alike():
    looks = [colour_of(k) for k in range(35)]
    assert len({str(look) for look in looks}) == 35
    assert len(set(shades("#0072B2", 5))) == 5


def test_every_picture_stands_alone():
    """An alternative text, no id that another picture could have, names of strangers as text."""
    x = np.linspace(-80, 80, 33)
    evil = "<b>&$x$"
    curve = Curve(x, np.exp(-((x - 30) ** 2) / 50), evil, "#0072B2", theta_i=30.0)
    dots = Curve(x, np.exp(-((x - 30) ** 2) / 50), "readings", "#0072B2", marker="o")
    theta = np.linspace(0, 80, 9)
    pictures = [
        in_plane([curve, dots], evil, log=False),
        in_plane([curve, dots], evil, log=True),
        polar([curve], evil, log=False),
        polar([curve], evil, log=True),
        hemisphere_map(np.ones(disc_points()[1].size), (0.1, 10.0), 30.0, evil),
        albedo_figure([AlbedoCurve(theta, 0.5 + 0 * theta, np.where(theta > 60, np.inf, 0.1), evil, "#0072B2")], evil),
        residual_map(*median_grid(np.array([1.0, 40.0]), np.array([2.0, 50.0]), np.array([0.1, -0.2]), True), evil),
        residual_histogram(np.array([0.1, -1.0, 9.0]), "u_f", "#0072B2", evil),
    ]
    pictures = [p.svg() for p in pictures]
    ids = [i for p in pictures for i in re.findall(r'\sid="([^"]+)"', p)]
    assert len(ids) == len(set(ids))
    for p in pictures:
        assert p.startswith("<svg ") and p.count('aria-label="&lt;b&gt;&amp;$x$"') == 1 and "<b>" not in p
        assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", p)
