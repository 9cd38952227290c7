"""Directions that fill a range: by distances that are known in closed form, and against a sequence that fills it."""

import numpy as np
import pytest

from gonio.instrument.instrument import Instrument
from gonio.instrument.pace import Pace
from gonio.models.geometry.directions import from_spherical
from gonio.planning.candidates import both_turning
from gonio.planning.space_filling import anywhere, space_filling, squared_distances
from gonio.planning.ways import Way

INSTRUMENT = Instrument(shadow=0.05)
SOME = np.radians([[20.0, 50.0], [10.0, 100.0], [60.0, 30.0], [200.0, 15.0]])


def turned(angles, azimuth, mirrored=False):
    theta_i, phi_i, theta_o, phi_o = angles
    sign = -1 if mirrored else 1
    return np.stack([theta_i, sign * phi_i + azimuth, theta_o, sign * phi_o + azimuth])


def test_distances_are_none_between_what_leaves_a_surface_the_same():
    exchanged = SOME[[2, 3, 0, 1]]
    for other in (SOME, exchanged, turned(SOME, 1.3), turned(exchanged, 0.4, mirrored=True)):
        assert np.diagonal(squared_distances(SOME, other, True)) == pytest.approx([0.0, 0.0], abs=1e-12)
    for other, same in ((SOME, True), (exchanged, True), (turned(SOME, 1.3), False)):
        assert (np.diagonal(squared_distances(SOME, other, False)).max() < 1e-12) == same
    assert np.diagonal(squared_distances(SOME, exchanged, True, reciprocal=False)).min() > 0.1


def test_the_least_distance_over_turns_is_that_of_the_best_of_many():
    wi, wo = (np.stack(from_spherical(SOME[k], SOME[k + 1], np)) for k in (0, 2))
    chords = []
    for azimuth in np.linspace(0, 2 * np.pi, 400):
        for mirrored in (False, True):
            other = turned(SOME[:, 1:], azimuth, mirrored)
            vi, vo = (np.stack(from_spherical(other[k], other[k + 1], np))[:, 0] for k in (0, 2))
            chords.append(np.sum((wi[:, 0] - vi) ** 2) + np.sum((wo[:, 0] - vo) ** 2))
    assert squared_distances(SOME, SOME, True, False)[0, 1] == pytest.approx(min(chords), rel=1e-3)


@pytest.mark.parametrize("isotropic", [True, False])
def test_none_of_the_range_is_as_far_as_a_sequence_leaves_it(isotropic):
    filling, every = space_filling(INSTRUMENT, isotropic, 30), anywhere(INSTRUMENT, isotropic, 2000)
    assert filling.shape == (4, 30)
    ours, theirs = (np.sqrt(squared_distances(every, a, isotropic).min(axis=1)) for a in (filling, every[:, :30]))
    assert ours.max() < 0.9 * theirs.max() and ours.mean() < 0.95 * theirs.mean()
    assert (filling[0] <= filling[2] + 1e-9).all()  # the steeper light, which counts more


def test_each_way_is_filled_and_directions_out_of_reach_are_not():
    ways = (Way(), Way(1, -1))
    filling = space_filling(Instrument(ranges=((0.0, 1.0), (0.0, 6.28), (0.0, 3.0), (0.0, 6.28))), False, 11, ways)
    assert [int(way.reads(filling).sum()) for way in ways] == [6, 5]
    assert filling[0].max() <= 1.0
    blind = Instrument(ranges=((0.0, 0.1), (0.0, 0.0), (0.0, 0.1), (0.0, 0.0)), shadow=1.0)
    assert space_filling(blind, True, 5).shape == (4, 0)


def test_azimuths_are_shared_by_both_axes_as_they_are_fast():
    angles = np.stack([SOME[0], [0.0, 0.0], SOME[2], np.radians([170.0, 20.0])])
    for speeds, share in ((0.2, 1 / 2), ((0.2, 0.1, 0.2, 0.3), 1 / 4)):
        instrument = Instrument(pace=Pace(axis_speed=speeds))
        both = both_turning(angles, instrument)
        np.testing.assert_allclose(both[3] - both[1], angles[3], atol=1e-12)
        np.testing.assert_allclose(np.diff(both[1]), share * np.radians(150), atol=2e-5)
        np.testing.assert_array_equal(both[[0, 2]], angles[[0, 2]])
        one, other = (instrument.pace.moving(a[:, :1], a[:, 1:]) for a in (angles, both))
        assert other[0] <= one[0] + 1e-5
    fixed = Instrument(ranges=((0.0, 1.5), (0.0, 0.0), (0.0, 1.5), (0.0, 3.2)))
    np.testing.assert_array_equal(both_turning(angles, fixed)[1], [0.0, 0.0])


@pytest.mark.parametrize("isotropic", [True, False])
def test_what_fills_beside_readings_leaves_holes_as_small_as_all_chosen_at_once(isotropic):
    every = anywhere(INSTRUMENT, isotropic, 2000)
    first = space_filling(INSTRUMENT, isotropic, 20)
    again = space_filling(INSTRUMENT, isotropic, 20, read=turned(first, 0.0 if not isotropic else 2.1))
    at_once = space_filling(INSTRUMENT, isotropic, 40)
    holes = [
        np.sqrt(squared_distances(every, a, isotropic).min(axis=1).max())
        for a in (first, np.concatenate([first, again], axis=1), at_once)
    ]
    assert again.shape == (4, 20)
    assert holes[1] < 1.15 * holes[2] and holes[1] < 0.9 * holes[0]


def test_a_range_read_everywhere_has_no_place_left_to_fill():
    blind_but_one = Instrument(ranges=((0.5, 0.5), (0.0, 0.0), (0.2, 0.2), (0.0, 0.0)))
    assert space_filling(blind_but_one, False, 5, read=np.array([[0.5], [0.0], [0.2], [0.0]])).shape == (4, 0)
