"""What a fit says of itself first: good only where nothing known speaks against it."""

import numpy as np
import pytest

import gonio
from gonio.fitting.fit_table import fit
from gonio.fitting.judgement import judge_fit
from support.fit_tables import COARSE_SPHERICAL
from support.fit_tables import ONE_LOBE as ONE
from support.fit_tables import coarse_table_of as table_of

FACTS = {"converged": True, "metrics": {"relative_rms": 0.01, "reduced_chi2": 1.0, "largest_albedo": 0.5}}


@pytest.mark.parametrize(
    ("metrics", "verdict", "words"),
    [
        ({}, "good", "reduced χ² 1"),
        ({"reduced_chi2": 0.01}, "good", "may be stated too large"),
        ({"reduced_chi2": 2.0}, "fair", "1.4 times the stored uncertainties"),
        ({"reduced_chi2": 20.0}, "poor", "4.5 times"),
        ({"reduced_chi2": 2140.0}, "failed", "46 times"),
        ({"largest_albedo": 8.4}, "poor", "albedo 8.4"),
        ({"reduced_chi2": None, "relative_rms": None, "largest_albedo": None}, "good", "it converged"),
    ],
)
def test_the_worst_that_is_known_decides(metrics, verdict, words):
    judgement = judge_fit({**FACTS, "metrics": {**FACTS["metrics"], **metrics}})
    assert judgement.verdict == verdict and words in judgement.sentence


def test_residuals_above_the_noise_are_not_called_noise():
    noisy = {**FACTS, "residuals": {"noisiness": {"verdict": "noise"}}}
    sentences = [
        judge_fit({**noisy, "metrics": {**FACTS["metrics"], "reduced_chi2": c}}).sentence for c in (1.0, 900.0)
    ]
    assert ["its residuals are noise" in sentence for sentence in sentences] == [True, False]


def test_a_few_readings_that_decide_the_numbers_are_said_first():
    """A tenth of the readings half as bright again, in noise of 2 %: by least squares they move the numbers."""
    rng = np.random.default_rng(7)
    angles = (rng.uniform(0, 1.3, 400), 0.0, rng.uniform(0, 1.3, 400), rng.uniform(-np.pi, np.pi, 400))
    f = gonio.material("lambert(rho=0.2) + 0.3 * ggx(alpha=0.3)").f(*angles)[..., 0]
    read = f * (1 + 0.02 * rng.standard_normal(400)) * np.where(rng.random(400) < 0.1, 1.5, 1.0)
    table = gonio.Table.from_arrays(*angles, read)
    plain, robust = (fit(table, "lambert + ggx", starts=1, robust=r) for r in (None, "tukey"))
    assert plain.judgement.verdict == "fair" and "stand out" in plain.judgement.sentence
    assert robust.judgement.verdict == "good"


def test_a_fit_that_did_not_converge_has_failed_whatever_its_numbers_are():
    assert judge_fit({**FACTS, "converged": False, "reason": "the cost is not finite"}).verdict == "failed"


def test_a_model_that_explains_nothing_fails_and_the_true_one_does_not():
    table = table_of(ONE, noise=0.01)
    nothing, truth = fit(table, "lambert", starts=1), fit(table, "lambert + ggx(f0=0.04)", starts=1)
    assert nothing.judgement.verdict == "failed" and nothing.exit_status == 1 and nothing.converged
    assert truth.judgement.verdict == "good" and truth.exit_status == 0
    assert truth.metrics["unexplained"] < 1e-3 < 0.5 < nothing.metrics["unexplained"]


def test_a_model_that_creates_energy_says_so_with_its_albedo():
    """Readings of a lobe of strength 1.4 over a diffuser of .5: at normal incidence about 1.9 of the light."""
    result = fit(table_of("lambert(rho=.5) + 1.4 * ggx(alpha=.2)"), "lambert + ggx", starts=1)
    assert result.judgement.verdict == "poor" and "reflects more" in result.notes[0]
    exact = float(np.max(result.albedo(np.radians([0, 30, 60, 75, 85.0])).value))
    assert result.metrics["largest_albedo"] == pytest.approx(exact, rel=1e-3) and exact > 1.5


def test_a_narrow_brushed_lobe_that_creates_energy_is_not_missed():
    """Of a lobe of widths 0.003 and 0.3 a sum over fixed directions misses a third: 1.2 times it would pass for 0.8."""
    table = table_of("1.2 * beckmann(alpha_x=0.003, alpha_y=0.3)", COARSE_SPHERICAL)
    result = fit(table, "~1.2 * beckmann(alpha_x~0.003, alpha_y~0.3)", starts=0)
    assert result.metrics["largest_albedo"] == pytest.approx(1.2, rel=0.01) and result.judgement.verdict == "poor"
