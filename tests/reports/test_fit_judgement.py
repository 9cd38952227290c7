"""The sentence on a fit: the worst fault first, and none where there is none."""

import pytest

from gonio.models.expression.builder import build
from gonio.reports.fit_judgement import judge_fit

GOOD = {
    "converged": True, "reason": "stationary", "metrics": {"relative_rms": 0.01, "reduced_chi2": 1.02},
    "residuals": {"noisiness": {"verdict": "noise"}, "worst_region": ""}, "undetermined": [],
}  # fmt: skip
DARK, BRIGHT = build("lambert(rho=0.4)"), build("lambert(rho=1) + lambert(rho=0.5)")


def test_a_good_fit_has_no_fault():
    judged = judge_fit(GOOD, DARK)
    assert judged.verdict == "good"
    assert judged.sentence == (
        "A good fit: it converged (reduced χ² 1.02, relative rms 0.01, its residuals are noise, albedo at most 0.4)."
    )


@pytest.mark.parametrize(
    ("change", "model", "verdict", "words"),
    [
        ({"converged": False, "reason": "steps ran out"}, DARK, "poor", "it did not converge (steps ran out)"),
        ({}, BRIGHT, "poor", "its model reflects more light than it receives (albedo 1.5 at θi"),
        ({"metrics": {"relative_rms": 0.81}}, DARK, "poor", "it leaves 81 % of the readings' rms unexplained"),
        ({"metrics": {"reduced_chi2": 2140.0}}, DARK, "poor", "(reduced χ² 2,140)"),
        ({"metrics": {"reduced_chi2": 1.5}}, DARK, "fair", "1.22 times the stored uncertainties"),
        ({"residuals": {"noisiness": {"verdict": "structure"}, "worst_region": "θh 0–1°"}}, DARK, "fair", "at θh 0–1°"),
        ({"undetermined": ["a and b"]}, DARK, "fair", "1 combination of its numbers open"),
    ],
)
def test_each_fault_is_named(change, model, verdict, words):
    judged = judge_fit(GOOD | change, model)
    assert judged.verdict == verdict and words in judged.sentence


def test_the_worst_comes_first():
    faults = {"converged": False, "metrics": {"relative_rms": 0.9, "reduced_chi2": 7.0}, "undetermined": ["a"]}
    sentence = judge_fit(GOOD | faults, BRIGHT).sentence
    places = [sentence.index(w) for w in ("did not converge", "more light", "unexplained", "uncertainties", "open")]
    assert places == sorted(places)


def test_what_a_fit_does_not_say_is_no_fault():
    assert judge_fit({"converged": True}, DARK).sentence == "A good fit: it converged (albedo at most 0.4)."
