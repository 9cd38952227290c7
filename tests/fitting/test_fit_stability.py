"""Fits where they are hard: each is right, or says that it is not; the whole table is a benchmark."""

import pathlib
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "benchmarks" / "fits"))

import fit_stability

from gonio.stability.problems import RECOVERIES, tagged

EXPECTED = {
    "α = 0.002, MERL's spacing": "right",
    "α = 1, 5° grid": "right",
    "F₀ = 0": "right",
    "1 % outliers × 100, robust": "right",
    "20 % outliers × 100, robust": "right",
    "60 % of cells missing": "right",
    "F₀ free, angles to 25°": "right",
    "two equal lobes, no noise": "right",
    "outside the family: Beckmann, σ unknown": "says so",
    "all zero": "right",
    "constant": "right",
    "12 samples": "right",
    "3 samples": "right",
    "2 samples": "refused",
}
SAYS = {
    "F₀ free, angles to 25°": "only the combination ggx.f0·ggx.scale",
    "two equal lobes, no noise": "no readings would separate them",
    "outside the family: Beckmann, σ unknown": "structure, not noise",
    "all zero": "active bound: lambert.rho",
    "12 samples": "too few readings to tell noise from structure",
    "2 samples": "1 more are needed",
}


@pytest.mark.parametrize("problem", tagged(RECOVERIES, "hard", "test"), ids=lambda problem: problem.name)
def test_nothing_is_wrong_in_silence(problem):
    verdict, _, warnings = fit_stability.outcome(problem, 0)
    assert verdict == EXPECTED[problem.name], warnings
    assert any(SAYS.get(problem.name, "") in words for words in warnings or [""]), warnings
