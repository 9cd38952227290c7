"""Stated uncertainties of the wrong pattern: those of the fit are of the scatter, and right ones stay as they are."""

import numpy as np

import gonio

NAMES = ("lambert.rho", "ggx.alpha", "ggx.scale")


def deviations(right: bool, draws: int = 20) -> tuple[np.ndarray, int]:
    """(numbers less the truth) / u of fits to noise of 5 % of f, and how many say that the scatter is another.

    Stated is the noise, or one uncertainty for all readings with the same mean square.
    """
    off, told = [], 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        truth = dict(zip(NAMES, rng.uniform((0.05, 0.1, 0.1), (0.3, 0.4, 0.5)), strict=True))
        rho, alpha, scale = truth.values()
        angles = (rng.uniform(0, 1.3, 600), 0.0, rng.uniform(0, 1.3, 600), rng.uniform(-np.pi, np.pi, 600))
        f = gonio.material(f"lambert(rho={rho}) + {scale} * ggx(alpha={alpha})").f(*angles)[..., 0]
        noise = 0.05 * f
        stated = noise if right else np.full(f.size, np.sqrt(np.mean(noise**2)))
        table = gonio.Table.from_arrays(*angles, f + noise * rng.standard_normal(f.size), u_f=stated)
        result = gonio.fit(table, "lambert + ggx", starts=1)
        free = {p.label: p for p in result.parameters if p.status != "fixed"}
        off.append([(free[n].value - truth[n]) / free[n].standard_uncertainty for n in NAMES])
        told += any("of like brightness scatter" in note for note in result.notes)
    return np.array(off), told


def test_one_uncertainty_for_all_readings_is_not_believed_where_the_bright_ones_scatter_more() -> None:
    """By the stated one the root mean square is 2.6, and the largest 7."""
    off, told = deviations(right=False)
    assert np.sqrt(np.mean(off**2)) < 1.6 and told > 15


def test_noise_as_it_is_stated_is_believed() -> None:
    off, told = deviations(right=True)
    assert np.sqrt(np.mean(off**2)) < 1.4 and told <= 1
