"""A narrow lobe over a dark ground, read by a counter: most readings are of no count, which is no structure."""

import math

import numpy as np
import pytest

import gonio

SCAN = gonio.scan("isotropic", step=math.radians(10))


def noisiness(expression: str, photons: float, seed: int) -> str:
    table = gonio.measure(expression, gonio.Instrument(photons=photons), scan=SCAN, seed=seed)
    result = gonio.fit(table, "beckmann(alpha=?)", starts=1)
    assert result.residuals is not None
    return result.residuals.noisiness.verdict


@pytest.mark.parametrize("photons", [300, 1e4, 1e6])
def test_readings_of_no_count_are_no_structure(photons):
    rng = np.random.default_rng(int(photons))
    verdicts = [noisiness(f"beckmann(alpha={rng.uniform(0.06, 0.35):.4f})", photons, seed) for seed in range(4)]
    assert verdicts == ["noise"] * 4


@pytest.mark.parametrize("ground", [3e-6, 1e-3])
def test_light_that_the_model_leaves_out_is_structure(ground):
    """Of the fainter one a reading holds a third of a count."""
    assert noisiness(f"beckmann(alpha=0.15) + lambert(rho={ground})", 1e5, 0) == "structure"
