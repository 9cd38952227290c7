import json
import math

import numpy as np
import pytest

from gonio.checks.certificate import Certificate, Property, place_in_words, place_of, verdict_of, worst


def prop(name, verdict):
    return Property(name, verdict, 0.1, 0.01, 0.2)


@pytest.mark.parametrize(
    ("residual", "bound", "verdict"),
    [
        (0.5, 0.5, "pass"),
        (0.5, 0.6, "undecided"),
        (1.5, 0.5, "undecided"),
        (1.5, 0.4, "fail"),
        (-3.0, 1.0, "pass"),
    ],
)
def test_a_verdict_leaves_room_for_the_error_of_the_judgement(residual, bound, verdict):
    assert verdict_of(residual, bound, 1.0) == verdict


@pytest.mark.parametrize(
    ("residual", "bound"), [(math.nan, 0.0), (0.0, math.nan), (0.0, math.inf), (math.inf, math.inf)]
)
def test_what_is_not_a_number_decides_nothing(residual, bound):
    assert verdict_of(residual, bound, 1.0) == "undecided"


def test_fail_comes_before_undecided_before_pass():
    assert worst(["pass", "undecided", "fail"]) == "fail"
    assert worst(["pass", "undecided"]) == "undecided"
    assert worst(["pass", "not applicable"]) == "pass"
    assert worst(["not applicable"]) == "undecided"


def test_the_overall_verdict_is_about_reciprocity_and_energy_unless_strict():
    properties = [prop("reciprocity", "pass"), prop("energy", "pass"), prop("positivity", "fail")]
    assert (
        Certificate("a", "model", properties).overall,
        Certificate("a", "model", properties).exit_status,
    ) == ("pass", 0)
    assert Certificate("a", "model", properties, strict=True).exit_status == 1
    assert Certificate("a", "model", [prop("energy", "undecided"), *properties[:1]]).exit_status == 3


def test_its_json_holds_everything_and_no_nan():
    p = Property("energy", "undecided", math.inf, np.float64(2.0), 0.01, series={"albedo": np.array([[1.0, np.nan]])})
    written = json.loads(Certificate("a", "table", [p]).to_json())
    assert written["properties"][0]["residual"] is None
    assert written["properties"][0]["series"]["albedo"] == [[1.0, None]]
    assert written["null"] == {
        "/properties/0/residual": "infinite", "/properties/0/series/albedo/0": "1 of 2: not known"
    }  # fmt: skip
    assert written["overall"] == "undecided" and written["exit_status"] == 3


def test_a_property_is_found_by_its_name():
    certificate = Certificate("a", "model", [prop("energy", "pass")])
    assert certificate["energy"].verdict == "pass"
    with pytest.raises(KeyError):
        certificate["colour"]


def test_a_certificate_says_what_its_verdict_is_the_worst_of():
    properties = [prop(name, "pass") for name in ("reciprocity", "energy", "isotropy", "agreement")]
    assert Certificate("a", "model", properties).basis == "reciprocity, energy and agreement"
    assert Certificate("a", "model", properties[:2]).basis == "reciprocity and energy"
    strict = Certificate("a", "model", properties, strict=True)
    assert strict.counted == ["reciprocity", "energy", "agreement"] and "but isotropy" in strict.basis


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (place_of(np.radians([40.0, 0.0, 50.0, 400.0]), "R"), "θi 40°, φi 0°, θo 50°, φo 40°, channel R"),
        ({"theta_from": 10.0, "theta_to": 20.0}, "θ 10–20°"),
        ({}, ""),
    ],
)
def test_a_place_in_words(place, words):
    assert place_in_words(place) == words
