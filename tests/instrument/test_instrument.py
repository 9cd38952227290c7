"""The instrument as a description: domains, systematic errors, true directions."""

import dataclasses
import json
import math

import numpy as np
import pytest

from gonio.instrument.instrument import Instrument, Systematic
from gonio.models.errors import GonioError


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"source_half_angle": -0.1}, "source_half_angle"),
        (
            {"detector_half_angle": 60},
            r"detector_half_angle is 60 rad \(3437.75°\); give from 0 to 0.785398 rad \(45°\)",
        ),
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
def test_what_is_outside_its_domain_is_refused_by_name(given, message):
    with pytest.raises(GonioError, match=message) as error:
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
    errors = [instrument.systematic_errors(seed) for seed in range(2000)]
    assert errors[5] == instrument.systematic_errors(5) and errors[5] != errors[6]
    angles = np.array([[d.tilt_x, d.tilt_y, d.theta_i, d.theta_o, d.phi] for d in errors]) / 0.01
    gains = (np.array([d.gain for d in errors]) - 1) / 0.02
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
    given = angles()
    wi, wo = Systematic().true_directions(given)
    np.testing.assert_allclose(wi, unit(*given[:2]), atol=1e-15)
    np.testing.assert_allclose(wo, unit(*given[2:]), atol=1e-15)


def test_arm_offsets_are_in_the_angles_and_a_tilt_in_the_angle_to_the_normal():
    given = angles()
    wi, wo = Systematic(theta_i=0.01, theta_o=-0.02, phi=0.03).true_directions(given)
    np.testing.assert_allclose(wi, unit(given[0] + 0.01, given[1]), atol=1e-15)
    np.testing.assert_allclose(wo, unit(given[2] - 0.02, given[3] + 0.03), atol=1e-15)
    tilted = Systematic(tilt_x=0.02, tilt_y=-0.01)
    wi, wo = np.array(tilted.true_directions(given))
    # The sample turns as a whole: angles between directions stay, those to its normal change.
    np.testing.assert_allclose(np.sum(wi * wo, axis=0), np.sum(unit(*given[:2]) * unit(*given[2:]), axis=0), atol=1e-14)
    turn_x = np.array([[1, 0, 0], [0, math.cos(0.02), -math.sin(0.02)], [0, math.sin(0.02), math.cos(0.02)]])
    turn_y = np.array([[math.cos(-0.01), 0, math.sin(-0.01)], [0, 1, 0], [-math.sin(-0.01), 0, math.cos(-0.01)]])
    normal = turn_y @ turn_x @ [0, 0, 1]
    np.testing.assert_allclose(wi[2], normal @ unit(*given[:2]), atol=1e-14)


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
    assert Systematic(tilt_y=math.radians(2)).to_dict()["tilt_y_deg"] == pytest.approx(2)
    source, detector = instrument.solid_angles()
    assert source == pytest.approx(2 * math.pi * (1 - math.cos(math.radians(1))), rel=1e-12) and detector == 0


def test_a_short_text_names_what_is_not_ideal():
    assert repr(Instrument()).split() == ["Instrument", "kind", "ideal:", "points,", "no", "noise,", "no", "error"]
    everything = Instrument(
        0.01, 0.02, 1e5, 0.1, 3.0, 2.0, 0.01, 0.001, 0.01, 1e6, 0.05, Systematic(tilt_x=math.radians(1)), 1e-4
    )
    lines = repr(everything).splitlines()
    assert len(lines) <= 12 and max(map(len, lines)) <= 100
    for text in ("source half angle 0.572958°", "photons 100000", "systematic  tilt x 1°"):
        assert text in repr(everything)
