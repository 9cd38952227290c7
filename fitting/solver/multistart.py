"""Multi-start descents on levels of growing size: all starts on few cells, the best ends on more, the last on all."""

import dataclasses

import numpy as np

from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.subsample import coarse_cells
from gonio.fitting.solver.convergence import eps
from gonio.fitting.solver.initial_guess import starting_points
from gonio.fitting.solver.levenberg_marquardt import Descent, Stopping, minimise

COARSE = 512
EACH = 48  # samples for each free number, where these are many
ROUGH = 1e4  # of the aim, where more readings follow
MIDDLE = 1 << 16
WORTHWHILE = 3  # times as many readings as a level has samples, for that level to spare anything
CLOSE = 1.05  # of the best cost on the middle level: what may still be the best on all readings
ROUNDINGS = 16.0  # of what is compared, by which two costs of one minimum may differ
SAME_COST = 1e-6  # relative difference of two costs that are one minimum


@dataclasses.dataclass(frozen=True)
class Search:
    """The best descent on all readings; the ends of all starts on the coarse `cells`, and how many of them agree."""

    best: Descent
    ends: list[Descent]
    agreed: int
    cells: np.ndarray


def search(problem: FitProblem, given: np.ndarray, starts: int, seed: int) -> Search | None:
    """The best descent from the starts of the data and random ones; None where no start has a finite cost.

    Args:
        problem: all readings.
        given: start of each free number (P,), NaN where none is given.
        starts: number of random starts.
        seed: of the random starts and of the subsamples.
    """
    n = problem.weight.shape[0]
    enough = max(COARSE, EACH * given.size)
    cells = coarse_cells(problem.readings, enough, seed) if n > WORTHWHILE * enough else np.arange(n)
    coarse = problem.subset(cells)
    ends = minimise(
        coarse, starting_points(coarse, given, starts, seed), Stopping(rough=1.0 if coarse is problem else ROUGH)
    )
    best = _best(ends)
    if best is None:
        return None
    agreed = sum(end.cost <= best.cost + _margin(best.cost, coarse.target_norm_squared) for end in ends)
    if coarse is problem:
        return Search(best, ends, agreed, cells)
    rest = distinct(ends, coarse.target_norm_squared)
    if n > WORTHWHILE * MIDDLE:
        some = np.sort(np.random.default_rng(seed).choice(n, MIDDLE, replace=False, shuffle=False))
        rest = minimise(problem.subset(some), [e.p for e in rest], Stopping(near=True, rough=ROUGH, rivals=True))
        least = min(e.cost for e in rest)
        rest = [e for e in distinct(rest, problem.target_norm_squared) if e.cost <= CLOSE * least] or rest
    best = _best(minimise(problem, [e.p for e in rest], Stopping(near=True, rivals=True))) or best
    return Search(best, ends, agreed, cells)


def distinct(ends: list[Descent], target_norm_squared: float, most: int = 3) -> list[Descent]:
    """The best descents of different cost, at most `most`, none more than half above the best."""
    kept: list[Descent] = []
    for end in sorted((e for e in ends if np.isfinite(e.cost)), key=lambda e: e.cost):
        if kept and end.cost > 1.5 * kept[0].cost + 1e-20 * target_norm_squared:
            break
        if all(end.cost > other.cost + _margin(other.cost, target_norm_squared) for other in kept):
            kept.append(end)
    return kept[:most]


def _margin(cost: float, target_norm_squared: float) -> float:
    rounding = ROUNDINGS * eps() * float(np.sqrt(max(cost, 0.0) * target_norm_squared))
    return SAME_COST * cost + 1e-20 * target_norm_squared + rounding


def _best(ends: list[Descent]) -> Descent | None:
    return min((e for e in ends if np.isfinite(e.cost)), key=lambda e: e.cost, default=None)
