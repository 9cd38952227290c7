"""Stated uncertainties: what people write is what is meant, and a measurement draws its errors from them."""

import math

import numpy as np
import pytest

from gonio.data.stated import SHAPES, StatedUncertainty, stated_uncertainties
from gonio.instrument import Instrument
from gonio.models.errors import GonioError


@pytest.mark.parametrize(
    ("name", "text", "standard", "dof"),
    [
        ("gain", "0.5 %", 0.005, math.inf),
        ("gain", "1% k 2 dof 12", 0.005, 12),
        ("solid_angle", "0.004", 0.004, math.inf),
        ("theta_i", "0.05 deg rectangular", math.radians(0.05) / math.sqrt(3), math.inf),
        ("theta_o", "2 mrad triangular dof 8", 2e-3 / math.sqrt(6), 8),
        ("phi", "0.1° u-shaped", math.radians(0.1) / math.sqrt(2), math.inf),
        ("tilt_x", 0.02, math.radians(0.02), math.inf),
        ("dark", 1e-5, 1e-5, math.inf),
    ],
)
def test_a_text_is_the_uncertainty_that_it_says(name, text, standard, dof):
    u = stated_uncertainties({name: text})[name]
    assert u.standard == pytest.approx(standard, rel=1e-12) and u.dof == dof
    again = stated_uncertainties({name: u.text})[name]
    assert again.standard == pytest.approx(standard, rel=1e-10) and again[2:] == u[2:]


def test_one_tilt_stands_for_both():
    assert set(stated_uncertainties({"tilt": "0.05 deg"})) == {"tilt_x", "tilt_y"}


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"gian": "1 %"}, "did you mean 'gain'"),
        ({"gain": "1 deg"}, r"\(%\)"),
        ({"tilt": "0.5 %"}, "deg, °, mrad, rad"),
        ({"gain": "much"}, "give a number with its unit"),
        ({"gain": "1 % normal rectangular"}, "such as"),
        ({"gain": "1 % rectangular k 2"}, "such as"),
        ({"gain": "1 % k 0"}, "k above 0"),
        ({"gain": "1 % dof 0"}, "dof from 1 up"),
        ({"gain": "-1 %"}, "from 0 to 50 %"),
        ({"tilt": "90 deg"}, "from 0 to 45 deg"),
        ({"gain": True}, "True"),
    ],
)
def test_what_is_none_is_refused_in_one_sentence(given, sentence):
    with pytest.raises(GonioError, match=sentence):
        stated_uncertainties(given)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dof", [math.inf, 12])
def test_errors_have_the_stated_deviation_and_stay_within_the_half_width(shape, dof):
    errors = StatedUncertainty("gain", 0.01, shape, dof).errors(np.random.default_rng(4).standard_normal(20_000))
    # A type A evaluation of 12 degrees of freedom: Student's law, wider than its scale by √(12/10).
    wider = math.sqrt(12 / 10) if shape == "normal" and dof == 12 else 1.0
    assert errors.std() == pytest.approx(0.01 * wider, rel=0.03) and abs(errors.mean()) < 4e-4
    if shape != "normal":
        assert np.abs(errors).max() <= 0.01 * SHAPES[shape]


def test_a_measurement_draws_what_is_stated_and_keeps_the_other_draws():
    stated = tuple(stated_uncertainties({"phi": "0.2 deg rectangular", "dark": "0.1 %", "solid_angle": "1 %"}).values())
    plain, described = Instrument(misalignment=0.01, calibration=0.02), Instrument(0, misalignment=0.01, stated=stated)
    draws = [described.systematic_errors(seed) for seed in range(300)]
    usual = [plain.systematic_errors(seed) for seed in range(300)]
    assert [d.tilt_x for d in draws] == [d.tilt_x for d in usual]
    assert np.std([d.phi for d in draws]) == pytest.approx(math.radians(0.2) / math.sqrt(3), rel=0.15)
    assert np.std([d.offset for d in draws]) == pytest.approx(1e-3, rel=0.15)
    assert np.std([d.gain for d in draws]) == pytest.approx(0.01, rel=0.15)
