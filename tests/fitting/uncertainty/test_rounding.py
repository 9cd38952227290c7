"""Readings rounded to a coarse step: the step is recognised, and uncertainties hold what rounding moves."""

import numpy as np
import pytest

import gonio
from gonio.data.layouts import scattered
from gonio.data.table import whole_table_of_values
from gonio.fitting.problem.readings import readings_of
from gonio.fitting.uncertainty.rounding import rounding_step

NAMES = ("lambert.rho", "ggx.alpha", "ggx.scale")


def values(seed: int, number: int = 400) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Angles, f of a dark surface with a lobe, and its numbers."""
    rng = np.random.default_rng(seed)
    truth = dict(zip(NAMES, rng.uniform((0.02, 0.1, 0.1), (0.3, 0.4, 0.5)), strict=True))
    theta = rng.uniform(0, 1.3, (2, number))
    angles = np.stack([theta[0], np.zeros(number), theta[1], rng.uniform(0, 2 * np.pi, number)])
    rho, alpha, scale = truth.values()
    return angles, gonio.material(f"lambert(rho={rho}) + {scale} * ggx(alpha={alpha})").f(*angles)[..., 0], truth


def deviations(step: float, noise: float = 0.0, draws: int = 16) -> tuple[np.ndarray, int]:
    """(numbers less the truth) / u of fits to rounded readings, and how many fits say so."""
    off, told = [], 0
    for seed in range(draws):
        angles, f, truth = values(seed)
        f = f + noise * np.random.default_rng(seed).standard_normal(f.size)
        result = gonio.fit(gonio.Table.from_arrays(*angles, np.round(f / step) * step), "lambert + ggx", starts=1)
        free = {p.label: p for p in result.parameters if p.status != "fixed"}
        off.append([(free[n].value - truth[n]) / free[n].standard_uncertainty for n in NAMES])
        told += any("rounded to" in note for note in result.notes)
    return np.array(off), told


def test_uncertainties_hold_what_coarse_rounding_moves() -> None:
    """Without it the root mean square is 3 to 4, and the largest 10."""
    off, told = deviations(0.01)
    assert np.sqrt(np.mean(off**2)) < 1.7 and np.abs(off).max() < 4 and told > 8


def test_what_noise_hides_is_no_rounding() -> None:
    off, told = deviations(0.01, noise=0.01)
    assert np.sqrt(np.mean(off**2)) < 1.4 and told == 0


@pytest.mark.parametrize("step", [0.01, 0.002, 0.05 / np.pi, 1 / 256])
def test_the_step_of_rounded_values_is_recognised(step: float) -> None:
    angles, f, _ = values(3)
    rounded = whole_table_of_values(scattered(*angles), np.round(f / step)[:, None] * step)
    assert rounding_step(readings_of(rounded)) == pytest.approx(step, rel=1e-6)
    assert rounding_step(readings_of(whole_table_of_values(scattered(*angles), f[:, None]))) == 0.0
