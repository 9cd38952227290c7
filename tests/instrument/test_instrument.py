"""The instrument as a description: domains, systematic errors, true directions."""

import dataclasses
import json
import math

import numpy as np
import pytest

from gonio.instrument.instrument import Instrument, Systematic, systematic_to_dict, true_directions
from gonio.models.errors import GonioError


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"source_half_angle": -0.1}, "source_half_angle"),
        ({"detector_half_angle": 1.0}, "detector_half_angle"),
        ({"noise": math.nan}, "noise"),
        ({"photons": 0}, "photons is 0"),
        ({"photons": 1e20}, "photons is 1e"),
        ({"read_noise": 3.0}, "give photons too"),
        ({"dark": 3.0}, "give photons too"),
        ({"saturation": 1e5}, "give photons too"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"ambient": "much"}, "ambient"),
    ],
)
def test_what_is_outside_its_domain_is_refused_by_name(given, said):
    with pytest.raises(GonioError, match=said) as error:
        Instrument(**given)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("given", [{"tilt_x": math.inf}, {"phi": 2.0}, {"gain": 0.0}, {"gain": -1.0}])
def test_impossible_systematic_errors_are_refused(given):
    with pytest.raises(GonioError, match=next(iter(given))):
        Systematic(**given)


def test_the_default_is_ideal_and_infinitely_many_photons_make_no_shot_noise():
    ideal = Instrument()
    assert not ideal.has_noise and not ideal.has_apertures
    assert ideal.to_dict() == {} and ideal.solid_angles() == (0.0, 0.0)
    assert ideal.systematic_errors(7) == Systematic() and Systematic().aligned
    assert Instrument(photons=math.inf) == ideal


def test_systematic_errors_are_drawn_from_the_seed_with_the_stated_deviations():
    instrument = Instrument(misalignment=0.01, calibration=0.02)
    drawn = [instrument.systematic_errors(seed) for seed in range(2000)]
    assert drawn[5] == instrument.systematic_errors(5) and drawn[5] != drawn[6]
    angles = np.array([[d.tilt_x, d.tilt_y, d.theta_i, d.theta_o, d.phi] for d in drawn]) / 0.01
    gains = (np.array([d.gain for d in drawn]) - 1) / 0.02
    for z in (*angles.T, gains):
        assert abs(z.mean()) < 4 / math.sqrt(2000) and abs(z.var() - 1) < 0.15
    assert np.abs(np.corrcoef(angles.T) - np.eye(5)).max() < 0.1
    given = Systematic(tilt_x=0.003)
    assert dataclasses.replace(instrument, systematic=given).systematic_errors(5) == given


def angles(n=50):
    rng = np.random.default_rng(1)
    polar, azimuth = rng.uniform(0, 1.5, (2, n)), rng.uniform(0, 2 * np.pi, (2, n))
    return polar[0], azimuth[0], polar[1], azimuth[1]


def unit(theta, phi):
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def test_true_directions_are_those_of_the_table_for_an_aligned_instrument():
    at = angles()
    wi, wo = true_directions(Systematic(), at)
    np.testing.assert_allclose(wi, unit(*at[:2]), atol=1e-15)
    np.testing.assert_allclose(wo, unit(*at[2:]), atol=1e-15)


def test_arm_offsets_are_seen_in_the_angles_and_a_tilt_in_the_angle_to_the_normal():
    at = angles()
    wi, wo = true_directions(Systematic(theta_i=0.01, theta_o=-0.02, phi=0.03), at)
    np.testing.assert_allclose(wi, unit(at[0] + 0.01, at[1]), atol=1e-15)
    np.testing.assert_allclose(wo, unit(at[2] - 0.02, at[3] + 0.03), atol=1e-15)
    tilted = Systematic(tilt_x=0.02, tilt_y=-0.01)
    wi, wo = np.array(true_directions(tilted, at))
    # The sample turns as a whole: angles between directions stay, those to its normal change.
    np.testing.assert_allclose(np.sum(wi * wo, axis=0), np.sum(unit(*at[:2]) * unit(*at[2:]), axis=0), atol=1e-14)
    turn_x = np.array([[1, 0, 0], [0, math.cos(0.02), -math.sin(0.02)], [0, math.sin(0.02), math.cos(0.02)]])
    turn_y = np.array([[math.cos(-0.01), 0, math.sin(-0.01)], [0, 1, 0], [-math.sin(-0.01), 0, math.cos(-0.01)]])
    normal = turn_y @ turn_x @ [0, 0, 1]
    np.testing.assert_allclose(wi[2], normal @ unit(*at[:2]), atol=1e-14)


def test_what_it_was_can_be_written_down():
    instrument = Instrument(
        source_half_angle=math.radians(1),
        photons=1e5,
        noise=0.01,
        shadow=math.radians(4),
        systematic=Systematic(phi=math.radians(0.5), gain=1.01),
    )
    written = json.loads(json.dumps(instrument.to_dict()))
    assert written["source_half_angle_deg"] == pytest.approx(1) and written["shadow_deg"] == pytest.approx(4)
    assert written["photons"] == 1e5 and written["systematic"]["phi_deg"] == pytest.approx(0.5)
    assert systematic_to_dict(Systematic(tilt_y=math.radians(2)))["tilt_y_deg"] == pytest.approx(2)
    source, detector = instrument.solid_angles()
    assert source == pytest.approx(2 * math.pi * (1 - math.cos(math.radians(1))), rel=1e-12) and detector == 0
