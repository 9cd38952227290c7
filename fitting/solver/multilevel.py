"""Where a fit spends its evaluations: all starts on few samples, the best ends on more, the last of them on all."""

import dataclasses
from collections.abc import Callable

import numpy as np

from gonio.fitting.problem.blocks import Samples
from gonio.fitting.problem.domains import Domains
from gonio.fitting.problem.parameterisation import Structure
from gonio.fitting.problem.readings import Readings, coarse_cells
from gonio.fitting.solver.initial_guess import LinearSolver, guesses, random_shapes
from gonio.fitting.solver.levenberg_marquardt import Problem
from gonio.fitting.solver.multistart import Descent, agreeing, descend_all, distinct
from gonio.models.errors import GonioError

COARSE = 512
EACH = 48  # samples for each free number, where these are many
ROUGH = 1e4  # of the aim, where more readings follow
MIDDLE = 1 << 16
WORTHWHILE = 3  # times as many readings as a level has samples, for that level to spare anything
DATA_STARTS = 3
CLOSE = 1.05  # of the best cost on the middle level: what may still be the best on all readings


@dataclasses.dataclass(frozen=True)
class Found:
    """The best descent on all readings; the ends of all starts on the coarse `cells`, and how many of them agree."""

    best: Descent
    ends: list[Descent]
    agreed: int
    cells: np.ndarray


def search(
    asked: str,
    problem: Callable[[Readings, np.ndarray], Problem],
    whole: Problem,
    said: np.ndarray,
    readings: Readings,
    weight: np.ndarray,
    starts: int,
    seed: int,
) -> Found:
    """The best descent from the starts of the data and `starts` random ones; `problem` makes one of some readings.

    Raises GonioError where the model has no finite cost at any start.
    """
    n, d = readings.f.shape[0], whole.domains
    enough = max(COARSE, EACH * said.size)
    cells = coarse_cells(readings, enough, seed) if n > WORTHWHILE * enough else np.arange(n)
    few, coarse, kept = readings, whole, weight
    if cells.size < n:
        few, kept = readings.part(cells), weight[cells]
        coarse = problem(few, kept)
    begun = _starts(coarse.structure, coarse.fixed, d, said, few, coarse.data, coarse.loss, kept, starts, seed)
    ends = descend_all(coarse, d, begun, rough=1.0 if cells.size == n else ROUGH)
    best = _best(ends)
    if best is None:
        raise GonioError(
            f"'{asked}' has no finite value at any start on these readings; hold a number with name=value, or begin "
            "elsewhere with name~value."
        )
    agreed = agreeing(ends, best, float(coarse.target_norm_squared))
    if cells.size < n:
        going = distinct(ends, float(coarse.target_norm_squared))
        if n > WORTHWHILE * MIDDLE:
            some = np.sort(np.random.default_rng(seed).choice(n, MIDDLE, replace=False, shuffle=False))
            going = descend_all(
                problem(readings.part(some), weight[some]), d, [e.p for e in going], near=True, rough=ROUGH, rivals=True
            )
            least = min(e.cost for e in going)
            going = [e for e in distinct(going, float(whole.target_norm_squared)) if e.cost <= CLOSE * least] or going
        best = _best(descend_all(whole, d, [e.p for e in going], near=True, rivals=True)) or best
    return Found(best, ends, agreed, cells)


def _best(ends: list[Descent]) -> Descent | None:
    return min((e for e in ends if np.isfinite(e.cost)), key=lambda e: e.cost, default=None)


def _starts(
    s: Structure, fixed, d: Domains, said, few: Readings, data: Samples, loss: str, weight, starts: int, seed: int
) -> list[np.ndarray]:
    solve = LinearSolver(s, fixed, few, data, loss, weight)
    shapes = guesses(s, said)
    same = all(g.linear for g in s.groups)  # linear in all its free numbers: every start is the same
    solved = solve(shapes + random_shapes(s, d, said, 0 if same else starts, seed))
    guessed = [p for p, _ in sorted(solved[: len(shapes)], key=lambda found: found[1])][:DATA_STARTS]
    return guessed[:1] if same else guessed + [p for p, _ in solved[len(shapes) :]]
