"""Pictures: projections, scales and labels that are right, and SVG that can stand on a page with others."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from gonio.figures.diagnostics import (
    AlbedoCurve,
    draw_albedo,
    draw_p_values,
    draw_residual_histogram,
    draw_residual_map,
    median_grid,
)
from gonio.figures.lobes import Curve, draw_in_plane, draw_polar, mesh_angles, value_range
from gonio.figures.maps import DIFFERENCE, HALF, colour_range, disc_points, draw_map, on_disc, slice_pairs
from gonio.figures.spheres import LIGHTS, sphere_pairs
from gonio.figures.style import FAINT, INK, PALETTE, colour_of, decades_between, picture, shades
from gonio.fitting.residuals.pair_angles import pair_angles
from gonio.reports.page import DARK_PAGE, on_dark, rules, themed
from gonio.text import sr_label


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


def test_a_sphere_is_seen_and_lit_from_where_it_says():
    inside, eye, lights = sphere_pairs(61)
    x, y = np.meshgrid(np.linspace(-1, 1, 123)[1::2], -np.linspace(-1, 1, 123)[1::2])
    np.testing.assert_allclose(eye.z, np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2), atol=1e-9)
    for light, (phase, _) in zip(lights, LIGHTS, strict=True):
        cos = light.x * eye.x + light.y * eye.y + light.z * eye.z
        np.testing.assert_allclose(cos, np.cos(np.radians(phase)), atol=1e-9)
        assert x[inside][np.argmax(light.z)] < 0 < y[inside][np.argmax(light.z)]


def test_a_slice_is_taken_at_the_angles_on_its_axes():
    wi, wo = slice_pairs()
    angles = pair_angles(wi, wo)
    h, d = (a.ravel() for a in np.meshgrid(np.minimum(HALF, 89.9), DIFFERENCE, indexing="ij"))
    np.testing.assert_allclose(angles.theta_h, h, atol=1e-6)
    np.testing.assert_allclose(angles.theta_d, d, atol=1e-6)
    assert wi.z.min() > 0 and wo.z.min() > 0


def test_a_mesh_has_the_mirror_direction_on_a_node():
    for theta_i in (0.0, 37.0, 80.0):
        theta, phi = mesh_angles(theta_i)
        assert theta.size * phi.size == mesh_angles(0.0)[0].size * mesh_angles(0.0)[1].size
        assert np.abs(theta - theta_i).min() < 0.02 and np.abs(phi - 180).min() < 0.02
        assert (np.diff(theta) >= 0).all() and (np.diff(phi) >= 0).all()


def luminance(colour):
    rgb = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def test_colours_are_seen_on_a_dark_page():
    """Contrast of lines at least 3, of letters at least 4.5 [WCAG 2.2, 1.4.11 and 1.4.3]; shades keep their order."""
    page = luminance(DARK_PAGE) + 0.05
    for colour, least in [*((c, 3.0) for c in PALETTE), (INK, 7.0), (FAINT, 4.5)]:
        assert (luminance(on_dark(colour)) + 0.05) / page >= least, colour
    for colour in PALETTE:
        shown = [luminance(on_dark(c)) for c in shades(colour, 4)]
        grey = len({colour[1:3], colour[3:5], colour[5:]}) == 1  # which are turned about
        assert shown == sorted(shown, reverse=not grey) and (min(shown) + 0.05) / page >= 2.5, colour
    text, used = themed('<path style="fill:#0072B2;stroke:#fde725"/><text style="fill:#222222">#0072B2</text>', PALETTE)
    assert used == {"#0072b2", "#222222"} and "stroke:#fde725" in text and ">#0072B2<" in text
    assert "fill:var(--c0072b2,#0072b2)" in text and "--c222222:" in rules(used)


def test_every_picture_stands_alone():
    """An alternative text, no id that another picture could have, names of strangers as text."""
    x = np.linspace(-80, 80, 33)
    evil = "<b>&$x$"
    curve = Curve(x, np.exp(-((x - 30) ** 2) / 50), evil, "#0072B2", theta_i=30.0)
    dots = Curve(x, np.exp(-((x - 30) ** 2) / 50), "readings", "#0072B2", marker="o")
    theta = np.linspace(0, 80, 9)
    albedo = AlbedoCurve(theta, 0.5 + 0 * theta, np.where(theta > 60, np.inf, 0.1), evil, "#0072B2")
    grid = median_grid(np.array([1.0, 40.0]), np.array([2.0, 50.0]), np.array([0.1, -0.2]), True)
    pictures = [
        picture(evil, draw_in_plane, [curve, dots], log=False),
        picture(evil, draw_in_plane, [curve, dots], log=True),
        picture(evil, draw_polar, [curve], log=False),
        picture(evil, draw_polar, [curve], log=True),
        picture(evil, draw_map, np.ones(disc_points()[1].size), (0.1, 10.0), 30.0),
        picture(evil, draw_albedo, [albedo]),
        picture(evil, draw_residual_map, grid, ("theta_h", "theta_d")),
        picture(evil, draw_residual_histogram, np.array([0.1, -1.0, 9.0]), True, "#0072B2"),
    ]
    pictures = [p.svg() for p in pictures]
    ids = [i for p in pictures for i in re.findall(r'\sid="([^"]+)"', p)]
    assert len(ids) == len(set(ids))
    for p in pictures:
        assert p.startswith("<svg ") and p.count('aria-label="&lt;b&gt;&amp;$x$"') == 1 and "<b>" not in p
        assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", p)


def test_p_values_stand_at_their_angles_where_bands_have_no_readings():
    axes = Figure().add_subplot()
    draw_p_values(axes, np.array([5.0, 15.0, 35.0]), np.full((3, 3), 0.5), 0.01)
    (image,) = axes.images
    assert image.get_extent() == [0, 40, 0, 40]
    assert image.get_array().mask[2].all() and not image.get_array().mask[3, [0, 1, 3]].any()
