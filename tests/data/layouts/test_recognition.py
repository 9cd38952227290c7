"""Lists of directions are recognised as the grids that they are, whatever their order and digits; others are not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.data import layouts
from gonio.data.layouts.recognition import half_difference_angles, recognised
from gonio.models.geometry.directions import to_half_difference

DEGREES = np.radians
GRIDS = {
    "isotropic": layouts.isotropic(DEGREES([0, 10, 30, 60]), DEGREES(np.r_[0:85:10]), DEGREES(np.r_[0:360:15])),
    "mirrored": layouts.isotropic(DEGREES([10, 30, 60]), DEGREES(np.r_[0:85:10]), DEGREES(np.r_[0:181:20])),
    "odd": layouts.isotropic(np.linspace(0, 1.5, 7), np.linspace(0, 1.5, 7), np.arange(7) * 2 * np.pi / 7),
    "in plane": layouts.in_plane(DEGREES([0, 10, 30, 60]), DEGREES(np.r_[-60:81:5])),
    "spherical": layouts.spherical(
        DEGREES([0, 30, 60]), DEGREES(np.r_[0:360:60]), DEGREES([0, 30, 60]), DEGREES(np.r_[0:360:30])
    ),
    "one azimuth": layouts.spherical(DEGREES([30, 60]), DEGREES([50]), DEGREES([0, 30, 60]), DEGREES(np.r_[0:360:30])),
    "half/difference": layouts.half_difference(
        DEGREES(np.r_[0:90:15]), DEGREES(np.r_[0:90:15]), DEGREES(np.r_[0:180:20])
    ),
    "whole turn of phi_d": layouts.half_difference(
        DEGREES(np.r_[5:90:15]), DEGREES(np.r_[0:90:15]), DEGREES(np.r_[0:360:30])
    ),
    "mirror": layouts.mirror(DEGREES([10, 30, 50]), DEGREES(np.r_[0:85:10]), DEGREES(np.r_[0:360:20])),
    "half a mirror": layouts.mirror(DEGREES([10, 30]), DEGREES(np.r_[0:85:10]), DEGREES(np.r_[0:181:20])),
    "merl": layouts.merl(counts=(10, 9, 18)),
}
each_grid = pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)


def listed(grid, seed=0, share=1.0):
    """The angles of the cells above the horizon in any order, a share of them drawn at random."""
    rng = np.random.default_rng(seed)
    cells = rng.permutation(np.flatnonzero(grid.readable()))
    cells = cells[rng.random(cells.size) <= share]
    return tuple(a[cells] for a in grid.angles()), cells


def vectors(angles):
    theta_i, phi_i, theta_o, phi_o = angles
    parts = [(np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)) for t, p in ((theta_i, phi_i), (theta_o, phi_o))]
    return np.concatenate(parts)


@each_grid
@pytest.mark.parametrize("digits", [12, 6, 4])
@pytest.mark.parametrize("unit", [np.pi / 180, 1.0], ids=["degrees", "radians"])
def test_a_grid_is_recognised_by_its_directions_alone(grid, digits, unit):
    angles, cells = listed(grid)
    printed = tuple(np.round(a / unit, digits) * unit for a in angles)
    rounding = 0.5 * 10.0**-digits * unit
    placed = recognised(printed, rounding)
    assert placed is not None and type(placed.layout) is type(grid) and placed.layout.shape == grid.shape
    for axis, expected in zip(placed.layout.axes.values(), grid.axes.values(), strict=True):
        np.testing.assert_allclose(axis, expected, atol=4 * rounding + 1e-9)
    found = np.array(placed.layout.angles())[:, placed.cells]
    error = np.linalg.norm(vectors(found) - vectors(angles), axis=0)
    assert np.percentile(error, 99) <= 8 * rounding + 1e-8
    assert np.unique(placed.cells).size >= cells.size - 8


@each_grid
def test_most_of_a_grid_is_that_grid_with_holes(grid):
    angles, _ = listed(grid, 1, 0.8)
    placed = recognised(angles)
    assert placed is not None and placed.layout.shape == grid.shape
    for axis, expected in zip(placed.layout.axes.values(), grid.axes.values(), strict=True):
        np.testing.assert_allclose(axis, expected, atol=1e-14)
    assert recognised(listed(grid, 1, 0.3)[0]) is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.integers(8, 300), st.sampled_from([0, 1, 8]))
def test_directions_at_random_are_no_grid(seed, count, digits):
    rng = np.random.default_rng(seed)
    degrees = rng.uniform(0, [[85], [360], [85], [360]], (4, count))
    angles = tuple(np.radians(np.round(degrees, digits)))
    assert recognised(angles, np.radians(0.5 * 10.0**-digits)) is None


def test_a_few_directions_are_listed_as_they_are():
    grid = layouts.in_plane([0.1], np.linspace(-1, 1, 7))
    assert recognised(listed(grid)[0]) is None


def test_one_reading_at_the_normal_stands_for_all_azimuths():
    grid = GRIDS["mirrored"]
    theta_i, phi_i, theta_o, phi_o = (a.copy() for a in grid.angles())
    kept = (theta_o > 0) | (phi_o == 0)
    placed = recognised((theta_i[kept], phi_i[kept], theta_o[kept], phi_o[kept]))
    assert placed is not None and placed.layout == grid
    at_normal = np.flatnonzero(theta_o == 0)
    np.testing.assert_array_equal(placed.origins[at_normal], at_normal - at_normal % grid.shape[2])
    others = np.flatnonzero(theta_o > 0)
    np.testing.assert_array_equal(placed.origins[others], others)


def test_light_from_the_other_side_is_the_same_grid_turned():
    theta_i, phi_i, theta_o, phi_o = GRIDS["isotropic"].angles()
    placed = recognised((theta_i, phi_i + np.pi, theta_o, (phi_o + np.pi) % (2 * np.pi)))
    assert placed is not None and placed.layout == GRIDS["isotropic"] and placed.turned == pytest.approx(np.pi)


@pytest.mark.parametrize("name", ["in plane", "isotropic", "half/difference"])
@pytest.mark.parametrize("azimuth", [90, 137, 347.5])
def test_light_across_the_sample_stays_where_it_was(name, azimuth):
    """Axes of a brushed sample are where the azimuths say: a grid turned below another light would exchange them."""
    theta_i, phi_i, theta_o, phi_o = listed(GRIDS[name])[0]
    turn = DEGREES(azimuth) - phi_i
    angles = theta_i, (phi_i + turn) % (2 * np.pi), theta_o, (phi_o + turn) % (2 * np.pi)
    placed = recognised(angles)
    if placed is not None:
        kept = np.array(placed.layout.angles())[:, placed.cells]
        np.testing.assert_allclose(vectors(kept), vectors(angles), atol=1e-7)


def test_half_and_difference_angles_are_those_of_the_models():
    angles = tuple(np.random.default_rng(0).uniform(0.1, 1.4, (4, 50)))
    wi, wo = layouts.scattered(*angles).directions()
    theta_h, phi_h, theta_d, phi_d = to_half_difference(wi, wo)
    np.testing.assert_allclose(half_difference_angles(angles), [theta_h, phi_h, theta_d, phi_d], atol=1e-6)


@pytest.mark.parametrize("grid", [GRIDS["mirrored"], GRIDS["half a mirror"]], ids=["isotropic", "mirror"])
def test_readings_of_the_far_side_are_taken_as_those_of_the_near_one(grid):
    theta_i, phi_i, theta_o, phi_o = listed(grid)[0]
    placed = recognised((theta_i, phi_i, theta_o, -phi_o % (2 * np.pi)))
    assert placed is not None and placed.layout.shape == grid.shape and placed.layout.mirrored_axes


def test_the_mirror_grid_begins_at_the_mirror_direction_and_turns_from_the_normal():
    theta_i, theta_m = np.radians(30), np.radians(10)
    wi, wo = layouts.mirror([theta_i], [0.0, theta_m], [0.0, np.pi]).directions()
    np.testing.assert_allclose([wi.x[0] + wo.x[0], wo.y[0], wi.z[0] - wo.z[0]], 0, atol=1e-15)
    np.testing.assert_allclose(np.degrees(np.arccos(wo.z[2:])), [20, 40])
