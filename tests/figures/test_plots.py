"""Plots on axes: what they hold is f, evaluated by formulas of this file; angles out of range are refused."""

import io
import math
import re

import matplotlib
import numpy as np
import pytest
from PIL import Image

import gonio
from gonio.data import layouts
from gonio.data.table import Channels, whole_table_of_values
from gonio.figures.plots import plot_albedo, plot_lobe, plot_residuals, plot_slice, plot_sphere, thumbnail_svg
from gonio.models.errors import GonioError

RHO = (0.1, 0.2, 0.4)
EXPRESSION = f"lambert(rho={list(RHO)}) + 0.3 * phong(n=20)"


def formula(theta_i, theta_o, rho):
    """Lambert and normalised Phong [Lafortune & Willems 1994], in the plane of incidence; theta_o signed, radians."""
    return rho / math.pi + 0.3 * 22 / (2 * math.pi) * np.maximum(np.cos(theta_o - theta_i), 0.0) ** 20


def table(slope=0.1):
    theta = np.radians(np.arange(0, 81, 10.0))
    layout = layouts.isotropic(theta, theta, np.radians(np.arange(0, 360, 30.0)))
    f = np.full((*layout.shape, 3), RHO) / math.pi
    f *= 1 + slope * (np.cos(theta)[:, None, None, None] * np.cos(theta)[None, :, None, None])
    return whole_table_of_values(layout, f, Channels.rgb(), name="paint")


@pytest.fixture(autouse=True)
def close_figures(monkeypatch):
    matplotlib.use("agg")
    yield
    from matplotlib import pyplot

    pyplot.close("all")


def dots(ax):
    """Coordinates of the dots of each set of readings."""
    return [p.get_path().vertices[::2] for p in ax.patches if hasattr(p, "get_path") and p.get_capstyle() == "round"]


@pytest.mark.parametrize("channel", [0, "B"])
def test_a_lobe_against_the_angle_is_f(channel):
    ax = plot_lobe(EXPRESSION, [0.2, math.radians(60)], channel=channel, polar=False)
    rho = RHO[0] if channel == 0 else RHO[2]
    assert ax.get_yscale() == "log" and len(ax.get_lines()) == 2
    for line, theta_i in zip(ax.get_lines(), (0.2, math.radians(60)), strict=True):
        x, y = line.get_data()
        np.testing.assert_allclose(y, formula(theta_i, np.radians(x), rho), rtol=1e-9)


def test_a_polar_lobe_has_radii_in_proportion_to_f():
    ax = plot_lobe(EXPRESSION, 0.5, polar=True, log=False)
    x, y = max((line.get_data() for line in ax.get_lines()), key=lambda d: d[0].size)
    radius, expected = np.hypot(x, y), formula(0.5, np.arctan2(x, y), RHO[1])
    np.testing.assert_allclose(radius / radius.max(), expected / expected.max(), rtol=1e-9)


def test_readings_of_a_table_are_dots_where_they_were_measured():
    t = table()
    ax = plot_lobe(t, [math.radians(32), math.radians(58)], channel="R", polar=False, log=False)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["θᵢ 30°", "θᵢ 60°"]
    for points, k in zip(dots(ax), (3, 6), strict=True):
        expected = {(float(s * np.degrees(a)), float(t.f[k, j, p, 0]))
                    for j, a in enumerate(t.layout.axes["theta_o"]) for s, p in ((1, 6), (-1, 0))}  # fmt: skip
        assert {(round(x, 6), y) for x, y in points} == {(round(x, 6), y) for x, y in expected}


def test_dots_of_readings_are_in_a_raster_too():
    """As many dark places as readings: strokes without length that are snapped to pixels vanish."""
    layout = layouts.in_plane(np.radians([30.0]), np.radians(np.arange(-80, 81, 5.0)))
    flat = whole_table_of_values(layout, np.full(layout.shape, 0.1), name="flat")
    ax = plot_lobe(flat, [math.radians(30)], polar=False)
    ax.grid(visible=False)
    data = io.BytesIO()
    ax.figure.savefig(data, format="png", dpi=100)
    pixels = np.asarray(Image.open(data).convert("RGB")).astype(int)
    blue = (pixels[..., 2] - pixels[..., 0] > 60).any(axis=0)
    row = np.flatnonzero((pixels[..., 2] - pixels[..., 0] > 60).sum(axis=1) > layout.size)
    blue = (pixels[row][..., 2] - pixels[row][..., 0] > 60).any(axis=0)
    assert np.count_nonzero(np.diff(blue.astype(int)) == 1) == layout.size


def test_a_slice_is_f_at_half_and_difference_angles():
    rho = 0.3
    image = plot_slice(f"lambert(rho={rho})").get_images()[0].get_array()
    assert np.ptp(image[..., 0]) == 0  # one value, one colour
    t = table()
    ax = plot_slice(t, channel="R")
    points = np.concatenate([c.get_offsets() for c in ax.collections])
    at_normal = points[np.hypot(*points.T) < 1e-9]
    assert len(at_normal) == 12  # θi = θo = 0, at each of the azimuths
    theta_d = np.radians(points[:, 1])
    assert len(points) < t.layout.size and theta_d.max() <= math.radians(80)


def test_a_sphere_of_white_is_white_towards_the_light():
    pixels = plot_sphere("lambert(rho=1)").get_images()[0].get_array()
    inside = pixels[..., 3] > 0
    assert pixels[..., :3][inside].max() == 255 and np.ptp(pixels[..., :3][inside], axis=-1).max() == 0
    assert plot_sphere(table()).get_images()[0].get_array()[..., 2].max() > 100


def test_albedo_of_a_diffuser_is_its_reflectance():
    for subject in (f"lambert(rho={list(RHO)})", table(slope=0)):
        lines = [line for line in plot_albedo(subject).get_lines() if len(line.get_xdata()) > 2]
        assert [line.get_label() for line in lines] == ["R", "G", "B"]
        x, y = lines[1].get_data()
        np.testing.assert_allclose(y[x <= 60], RHO[1], rtol=0.02)


def test_residuals_are_what_the_fit_misses():
    result = gonio.fit(table(), "lambert", starts=1)
    medians = plot_residuals(result).collections[0].get_array().compressed()
    relative = 100 * (np.asarray(result.brdf.rho) / math.pi / table().f - 1)
    assert np.ptp(medians) > 0 and relative.min() - 1e-9 <= medians.min() <= medians.max() <= relative.max() + 1e-9
    at_normal = plot_residuals(result, angles=("theta_i", "theta_o")).collections[0].get_array()[0, 0]
    assert at_normal == pytest.approx(np.median(relative[0, 0]), rel=1e-9)
    assert plot_residuals(result, angles=None).get_xlabel().endswith("%")
    with pytest.raises(GonioError, match="theta_h, theta_d"):
        plot_residuals(result, angles=("theta_i", "phi"))


def test_plots_draw_where_they_are_told_and_leave_settings_alone():
    from matplotlib import pyplot

    before = dict(matplotlib.rcParams)
    _, (first, second) = pyplot.subplots(1, 2)
    assert plot_lobe("lambert(rho=0.5)", ax=second) is second and not first.lines and second.lines
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("theta_i", [-0.1, 60, math.pi / 2, math.nan, []])
def test_angles_out_of_range_are_refused_with_their_unit(theta_i):
    with pytest.raises(GonioError, match="radians"):
        plot_lobe("lambert(rho=0.5)", theta_i)


def test_what_cannot_be_shown_is_refused():
    layout = layouts.in_plane(np.radians([10, 40]), np.radians([-60, -30, 30, 60]))
    flat = whole_table_of_values(layout, np.full(layout.shape, 0.1), name="flat")
    with pytest.raises(GonioError, match="one plane"):
        plot_sphere(flat)
    with pytest.raises(GonioError, match="hemisphere"):
        plot_albedo(flat)
    with pytest.raises(GonioError, match="no channel 'green'"):
        plot_lobe(table(), channel="green")


@pytest.mark.parametrize("subject", ["gold", table()], ids=["material", "table"])
def test_a_thumbnail_stands_alone(subject):
    svg = thumbnail_svg(subject)
    assert svg.startswith('<svg width="') and svg.rstrip().endswith("</svg>") and svg.count("<svg") == 1
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", svg) and len(svg) < 60_000
