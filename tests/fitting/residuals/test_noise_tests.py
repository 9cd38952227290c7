"""Tests of noise: runs, serial correlation and χ² have the distributions that they are published with."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from gonio.fitting.residuals.noise_tests import SIGNIFICANT, noise_tests, runs_z


def judged(t: np.ndarray, chi2: float | None = None, freedom: int = 1000):
    return noise_tests(t, np.ones_like(t, bool), chi2, freedom, False)


def test_runs_by_all_sequences():
    """Mean 0 and standard deviation 1 over every order of five ups and four downs."""
    z = [runs_z(np.isin(np.arange(9), up)) for up in itertools.combinations(range(9), 5)]
    assert np.mean(z) == pytest.approx(0, abs=1e-12) and np.std(z) == pytest.approx(1, abs=1e-12)
    assert math.isnan(runs_z(np.ones(9, bool)))


@pytest.mark.parametrize("freedom", [1, 10, 5000])
def test_chi_squared_beside_scipy(freedom):
    value = 1.3 * freedom
    tests = judged(np.random.default_rng(0).standard_normal((100, 1)), value, freedom)
    assert tests.chi2_p == pytest.approx(stats.chi2.sf(value, freedom)) and tests.reduced_chi2 == pytest.approx(1.3)


@pytest.mark.parametrize("channels", [2, 31])
def test_equal_channels_are_one(channels):
    """A flicker that all channels share is one sample a direction, for the mean and for χ² alike."""
    one = np.random.default_rng(channels).standard_normal((500, 1))
    chi2 = float(np.sum(one**2))
    tests = judged(np.repeat(one, channels, axis=1), channels * chi2, channels * 500)
    assert tests.channel_effect == pytest.approx(channels) and tests.verdict == "noise"
    assert tests.chi2_p == pytest.approx(stats.chi2.sf(chi2, 500))
    assert judged(np.random.default_rng(0).standard_normal((500, channels))).channel_effect == 1.0


def test_noise_and_structure_are_distinguished():
    rng = np.random.default_rng(0)
    wave = np.sin(np.arange(4000) / 50)[:, None]
    results = [judged(rng.standard_normal((4000, 2)) + a * wave) for a in (0.0, 0.05, 0.5)]
    assert [r.verdict for r in results] == ["noise", "noise", "structure"]
    # The largest of two estimates of a²/2 over 1 + a²/2, with standard deviation 1/√n each.
    assert results[2].shared == pytest.approx(0.125 / 1.125, abs=4 / math.sqrt(4000))
    one_sided = np.abs(rng.standard_normal((4000, 1)))
    assert judged(one_sided).verdict == "structure" and judged(one_sided[:5]).verdict == "unknown"


def test_false_alarms_are_as_rare_as_their_level():
    """At most as many as a binomial law allows in one of a million runs; two tests are made at each level."""
    rng, trials = np.random.default_rng(1), 400
    results = [judged(rng.standard_normal((300, 3))) for _ in range(trials)]
    alarms = {SIGNIFICANT: sum(r.verdict == "structure" for r in results) / 2}
    alarms |= {0.05: sum(r.runs_p < 0.05 for r in results)}
    for level, count in alarms.items():
        assert count <= stats.binom.isf(1e-6, trials, level)


def test_as_many_numbers_as_readings_test_nothing():
    rounding = 1e-16 * np.random.default_rng(0).standard_normal((2, 1))
    tests = noise_tests(rounding, np.ones((2, 1), bool), 1e-32, 0, True)
    assert tests.verdict == "untested" and math.isnan(tests.reduced_chi2)
