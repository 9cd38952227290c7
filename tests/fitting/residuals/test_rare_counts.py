"""A narrow lobe over a dark ground, read by a counter: most readings are of no count, which is no structure."""

import numpy as np
import pytest

from gonio.fitting.residuals.noise_tests import noise_tests
from gonio.fitting.residuals.rare_counts import of_rare_counts

SLOPES = np.tan(np.radians(np.linspace(0, 80, 60)))
GROUND = np.full(60 * 40, 3.0)


def lobe(peak: float, width: float) -> np.ndarray:
    """Expected counts of rings of readings about the mirror direction, (n,)."""
    return np.repeat(peak * np.exp(-((SLOPES / width) ** 2)), 40)


def verdict(counts: np.ndarray, expected: np.ndarray, model: np.ndarray) -> str:
    """Of residuals in the order of the rings, with the uncertainties of the expected counts."""
    f, m, weight = counts[:, None], model[:, None], 1 / np.sqrt(np.maximum(expected, 1e-300))[:, None]
    used = np.ones(f.shape, bool)
    scaled = (m - f) * weight
    return noise_tests(scaled, used & ~of_rare_counts(f, m, weight, used), None, f.size - 2, False).verdict


@pytest.mark.parametrize("peak", [30.0, 3e3, 3e5])
def test_readings_of_no_count_are_no_structure(peak):
    rng = np.random.default_rng(int(peak))
    for width in rng.uniform(0.05, 0.5, 20):
        expected = lobe(peak, width)
        assert verdict(rng.poisson(expected).astype(float), expected, expected) in ("noise", "unknown")


@pytest.mark.parametrize("ground", [0.3, 30.0])
def test_light_that_a_model_leaves_out_is_structure(ground):
    rng = np.random.default_rng(1)
    for width in rng.uniform(0.05, 0.5, 20):
        expected = lobe(3e3, width) + ground
        assert verdict(rng.poisson(expected).astype(float), expected, lobe(3e3, width)) == "structure"


def test_noise_of_a_dark_detector_is_tested_everywhere():
    """On less off readings are negative as often: nothing tells few counts of the signal apart."""
    rng = np.random.default_rng(2)
    expected = lobe(3e3, 0.2)
    counts = rng.poisson(expected + GROUND) - rng.poisson(GROUND).astype(float)
    weight = 1 / np.sqrt(expected + 2 * GROUND)[:, None]
    assert not of_rare_counts(counts[:, None], expected[:, None], weight, np.ones((counts.size, 1), bool)).any()
