"""What readings show of an error: its measure is bounded and symmetric, and its bound holds."""

import numpy as np
import pytest

from gonio.instrument.instrument import Instrument
from gonio.planning.adaptive.accuracy import FLOOR, difference, random_directions, readings_needed, shown
from gonio.planning.candidates import readable

SMALL = 1e-4


def test_differences_are_symmetric_bounded_and_relative():
    a, b = np.array([0.0, 1e-9, 0.2, 5.0]), np.array([1e9, 2e-9, 0.22, 4.0])
    d, _ = difference(a, b)
    np.testing.assert_array_equal(d, difference(b, a)[0])
    assert (d <= 1).all() and d[2] == pytest.approx(0.02 / (0.22 + FLOOR)) and d[1] < 1e-5


def test_noise_does_not_make_a_reading_larger():
    d, u = difference(np.full(10_000, 0.3), 0.3 + 0.03 * np.random.default_rng(0).normal(size=10_000), 0.03)
    assert np.mean(d**2 - u**2) == pytest.approx(0.0, abs=5e-4)


@pytest.mark.parametrize("isotropic", [True, False])
def test_directions_are_what_the_instrument_reads(isotropic):
    instrument = Instrument(shadow=0.1, detector_half_angle=0.1, ranges=((0.0, 1.2), (0.0, 6.2)) * 2)
    angles = random_directions(500, instrument, isotropic, np.random.default_rng(0))
    np.testing.assert_array_equal(readable(angles, instrument, isotropic), angles)
    assert angles.shape == (4, 500) and (np.ptp(angles[1]) == 0) == isotropic


@pytest.mark.parametrize("spread", [0.0, 0.5, 1.0])
def test_the_bound_holds_as_often_as_it_says(spread):
    rng = np.random.default_rng(1)
    draws = [shown(SMALL * np.exp(spread * rng.normal(size=100)) * rng.chisquare(1, 100)) for _ in range(500)]
    truth = np.sqrt(SMALL) * np.exp(spread**2 / 4)
    assert np.mean([e.bound >= truth for e in draws]) >= 0.93
    assert np.median([e.bound for e in draws]) < 1.5 * truth


@pytest.mark.parametrize("squares", [np.zeros(0), np.ones(1), np.full(30, 4.0)])
def test_few_or_impossible_squares_show_nothing(squares):
    assert shown(squares).bound == 1.0


def test_readings_that_a_target_takes_follow_from_the_power_by_which_the_error_falls():
    counts = np.array([60, 90, 130, 180, 260, 350, 480])
    falls = 3.0 * counts**-0.8
    assert readings_needed(counts, falls, 0.005) == pytest.approx((3.0 / 0.005) ** (1 / 0.8), rel=0.02)
    assert readings_needed(counts, falls, 0.03) == 0.0  # it is there
    assert readings_needed(counts, falls[::-1], 0.005) == np.inf
    assert readings_needed(counts[-2:], falls[-2:], 0.005) == 0.0  # too few tell nothing
