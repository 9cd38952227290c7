"""Where tables interpolate: inside of what was read, and not beyond, in holes, or beside a plane."""

import dataclasses

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.interpolation.coverage import covered
from gonio.data.table import whole_table_of_values
from gonio.models.geometry.directions import from_spherical

POLAR = np.radians(np.arange(0, 71, 10.0))
ROUND = np.radians(np.arange(0, 360, 20.0))


def pairs(*degrees):
    """Directions of lists of theta_i, theta_o, delta_phi."""
    theta_i, theta_o, turn = np.radians(np.array(degrees, float))
    return from_spherical(theta_i, np.zeros_like(theta_i), np), from_spherical(theta_o, turn, np)


def table(layout):
    return whole_table_of_values(layout, np.full(layout.shape, 0.1))


def as_list(layout):
    """The same directions without a grid."""
    return table(layouts.scattered(*(np.asarray(a) for a in layout.angles())))


@pytest.mark.parametrize("make", [table, as_list])
def test_a_grid_covers_its_inside_and_nothing_beyond(make):
    t = make(layouts.isotropic(POLAR, POLAR, ROUND))
    wi, wo = pairs([5, 33, 65, 80, 20, 80], [5, 47, 12, 20, 80, 80], [100, 190, 355, 10, 10, 180])
    np.testing.assert_array_equal(covered(t, wi, wo), [True, True, True, False, False, False])


@pytest.mark.parametrize("make", [table, as_list])
def test_one_incidence_covers_that_incidence(make):
    t = make(layouts.isotropic([np.radians(45)], POLAR, ROUND))
    wi, wo = pairs([45, 45.5, 30, 60, 45], [20, 60, 20, 20, 80], [10, 170, 10, 10, 10])
    np.testing.assert_array_equal(covered(t, wi, wo), [True, True, False, False, False])


@pytest.mark.parametrize("grid", [True, False])
def test_readings_in_a_plane_cover_the_plane(grid):
    signed = np.radians(np.arange(-70, 71, 10.0))
    layout = layouts.in_plane(np.radians([10, 20, 30.0]), signed)
    t = table(layout) if grid else as_list(layout)
    wi, wo = pairs([20, 20, 20, 20], [35, 35, 35, 35], [180, 0, 90, 120])
    np.testing.assert_array_equal(covered(t, wi, wo), [True, True, False, False])


def test_two_azimuths_are_no_turn():
    half = layouts.isotropic(POLAR, POLAR, np.radians([0.0, 180.0]))
    quarter = layouts.isotropic(POLAR, POLAR, np.radians([0.0, 90.0, 180.0]))
    wi, wo = pairs([20], [30], [60])
    assert not covered(table(half), wi, wo).any() and covered(table(quarter), wi, wo).all()


def test_a_hole_is_not_covered():
    t = table(layouts.isotropic(POLAR, POLAR, ROUND))
    t.flag[2:5, 2:5] = Flag.NOT_MEASURED
    wi, wo = pairs([30, 60], [30, 60], [40, 40])
    np.testing.assert_array_equal(covered(t, wi, wo), [False, True])
    flags = t.flag.reshape(-1, 1)
    kept = np.flatnonzero(flags[:, 0] == Flag.VALID)
    angles = [np.asarray(a)[kept] for a in t.layout.angles()]
    np.testing.assert_array_equal(covered(table(layouts.scattered(*angles)), wi, wo), [False, True])


def test_few_readings_all_about_cover_little():
    rng = np.random.default_rng(1)
    few = layouts.scattered(*np.radians(rng.uniform([[0], [0], [0], [0]], [[80], [0.001], [80], [360]], (4, 12))))
    polar, turn = np.arccos(rng.uniform(0.2, 1, (2, 500))), rng.uniform(0, 2 * np.pi, 500)
    wi, wo = from_spherical(polar[0], 0 * turn, np), from_spherical(polar[1], turn, np)
    assert covered(table(few), wi, wo).mean() < 0.3
    assert covered(table(layouts.scattered(polar[0], 0 * turn, polar[1], turn)), wi, wo).mean() > 0.95


def test_exchanged_readings_and_one_reading_are_covered():
    t = as_list(layouts.isotropic([np.radians(45)], np.radians([30.0]), [np.pi]))
    wi, wo = pairs([45, 30, 20], [30, 45, 10], [180, 180, 0])
    np.testing.assert_array_equal(covered(t, wi, wo), [True, True, False])


def test_beyond_counts_in_outermost_steps():
    t = table(layouts.isotropic(POLAR, POLAR, ROUND))
    wi, wo = pairs([75, 85], [20, 20], [0, 0])
    np.testing.assert_array_equal(covered(t, wi, wo, beyond=1.0), [True, False])
    assert not covered(dataclasses.replace(t, flag=np.full_like(t.flag, Flag.INVALID)), wi, wo).any()


@pytest.mark.parametrize("first", [0.0, 90.0, 180.0])
def test_light_of_one_azimuth_covers_as_light_at_any_other(first):
    turns, light = np.radians(first + np.arange(0, 91, 15.0)), np.radians(137.0)
    at_x, turned = (
        table(layout)
        for layout in (
            layouts.isotropic(POLAR, POLAR, np.sort(turns if first < 180 else 2 * np.pi - turns)),
            layouts.spherical(POLAR, [light], POLAR, np.sort((light + turns) % (2 * np.pi))),
        )
    )
    theta, phi = np.random.default_rng(1).uniform(0, 1.3, (2, 200)), np.random.default_rng(2).uniform(0, 6.2, (2, 200))
    wi, wo = (from_spherical(*w, np) for w in zip(theta, phi, strict=True))
    inside = covered(turned, wi, wo)
    np.testing.assert_array_equal(inside, covered(at_x, wi, wo))
    assert 0.1 < inside.mean() < 0.9


@pytest.mark.parametrize("light", [0.0, 137.0])
def test_every_reading_is_covered_at_the_edges_too(light):
    turns = np.radians((light + np.arange(0, 91, 10.0)) % 360)
    for layout in (
        layouts.isotropic(POLAR[1:], POLAR[1:], np.sort(turns)),
        layouts.spherical(POLAR[1:], np.radians([light, light + 20]), POLAR[1:], np.sort(turns)),
    ):
        wi, wo = layout.directions()
        assert covered(table(layout), wi, wo).all()
