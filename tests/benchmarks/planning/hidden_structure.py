"""What the space-filling shots of plans are for, and cost: structure that the model leaves out.

    python tests/benchmarks/planning/hidden_structure.py [STRUCTURES [MINUTES [MATERIAL]]]    (300 20)

A surface is its model times 1 + a · exp(−d²/2w²): d the distance of a direction from a random one, by chords of light
and detector, least over what leaves surfaces the same (`squared_distances`). Printed for each width w, degrees, and
each height a: the share of structures that the readings show at the 1 % level, after the free numbers have taken what
they can, by χ² or by the largest residual, half of the level each. The plans: without a filling share, by default, and
with shares that are filled by the first of a low-discrepancy sequence, as plans were made before; and how many times
the hours of the first each takes for the same uncertainty of its numbers.
"""

import sys
from collections.abc import Callable

import jax
import numpy as np
from planned_hours import INSTRUMENT, MATERIALS
from scipy.stats import chi2, ncx2, norm

from gonio.planning import planner as planning
from gonio.planning.candidates import Angles
from gonio.planning.planner import FILLING, Planner
from gonio.planning.prior import prior_of
from gonio.planning.shots import Shots
from gonio.planning.space_filling import anywhere, space_filling, squared_distances

WIDTHS, HEIGHTS, LEVEL = (3.0, 6.0, 12.0, 25.0), (0.01, 0.03, 0.1, 0.5, 3.0), 0.01


def sequence(instrument, isotropic, count, ways, read=None) -> Angles:
    """The first directions of a low-discrepancy sequence, by turns on each of the ways."""
    each = [anywhere(instrument, isotropic, 2 * count, way)[:, : count // len(ways) + 1] for way in ways]
    return np.concatenate(each, axis=1)[:, :count]


def shown(planner: Planner, shots: Shots, centres: Angles, width: float, height: float) -> float:
    """The share of structures that shots show."""
    sites = planner.sites(shots.angles)
    rows, sigma, f = sites.rows(shots.seconds)[0], np.sqrt(sites.variance(shots.seconds)[0]), sites.f[0]
    q = np.linalg.qr((flat := rows.reshape(-1, rows.shape[-1])) / np.linalg.norm(flat, axis=0))[0]
    bumps = np.exp(-0.5 * squared_distances(centres, shots.angles, planner.isotropic) / np.radians(width) ** 2)
    n, free = flat.shape
    missed, left = norm.isf(LEVEL / 4 / n), np.sqrt(np.maximum(1 - np.sum(q**2, axis=1), 1e-12))
    each = []
    for bump in bumps:
        signal = (bump[:, None] * f * height / sigma).ravel()
        signal -= q @ (q.T @ signal)
        together = ncx2.sf(chi2.isf(LEVEL / 2, n - free), n - free, max(float(signal @ signal), 1e-12))
        each.append(max(together, norm.sf(missed - np.max(np.abs(signal) / left))))
    return float(np.mean(each))


def main(structures: int, budget: float, only: str | None) -> None:
    fillings: tuple[tuple[str, float, Callable[..., Angles]], ...] = (
        ("none", 0.0, space_filling), ("default", FILLING, space_filling), ("sequence", FILLING, sequence),
        ("sequence", 0.2, sequence),
    )  # fmt: skip
    for name, truth in MATERIALS.items():
        if only not in (None, name):
            continue
        least = None
        for title, share, fill in fillings:
            planning.space_filling = fill
            planner = Planner(prior_of(truth, None), INSTRUMENT, space_filling=share)
            shots = planner.schedule(budget).shots
            variance = planner.mean_variance(planner.covariance(shots))
            least = least or variance
            other = anywhere(INSTRUMENT, planner.isotropic, 3 * structures)
            centres = other[:, np.random.default_rng(0).permutation(other.shape[1])[:structures]]
            print(
                f"{name}, {title} {share:.0%}: {shots.seconds.size} shots, × {variance / least:.3f} hours", flush=True
            )
            for width in WIDTHS:
                by_height = (f"{shown(planner, shots, centres, width, a):.0%} of {a:.0%}" for a in HEIGHTS)
                print(f"    {width:g}°: {', '.join(by_height)}", flush=True)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    count, minutes, material = [*sys.argv[1:], *("300", "20", "")[len(sys.argv) - 1 :]][:3]
    main(int(count), 60 * float(minutes), material or None)
