"""Where a sketch begins that has grown out of another: its numbers carried over, what is new guessed from the data."""

import numpy as np

from gonio.fitting.problem.domains import snapped
from gonio.fitting.selection.candidate_model import CandidateProblem, Number, Part, Scenery, numbers_of
from gonio.fitting.solver.levenberg_marquardt import Stopping, minimise
from gonio.fitting.solver.multistart import APART, WIDTHS, solve_amounts
from gonio.models.expression.paths import FACTOR

NEW = {"f0": 0.1, "gamma": 2.2, "r": 0.3, "rho": 0.3, FACTOR: 0.1, "alpha": 0.3, "alpha_x": 0.25, "alpha_y": 0.4}
REFINED = 2
STEPS, ROUGH = 80, 1e4  # of a descent, which ends where a step promises less than 1e-9 of the cost


def carried(old: tuple[Part, ...], p: np.ndarray, new: tuple[Part, ...], channels: int) -> np.ndarray:
    """Numbers (P,) for the parts `new` out of the numbers p of the parts `old`, in their order; NaN where none is."""
    before: dict[tuple, list[float]] = {}
    for u, value in zip(numbers_of(old, channels), p, strict=True):
        before.setdefault((u.part, u.name), []).append(float(value))
        before.setdefault((u.part, u.name, u.channel), []).append(float(value))

    def value(u: Number) -> float:
        for key in ((u.part, u.name, u.channel), (u.part, u.name)):
            if key in before:
                return float(np.mean(before[key]))
        if u.name in APART and (u.part, "alpha") in before:
            return APART[u.name] * float(np.mean(before[u.part, "alpha"]))
        if u.name == "alpha" and (u.part, "alpha_x") in before:
            return float(np.sqrt(np.mean(before[u.part, "alpha_x"]) * np.mean(before[u.part, "alpha_y"])))
        return float("nan") if u.part >= len(old) else NEW[u.name]

    return np.array([value(u) for u in numbers_of(new, channels)])


def fitted(parts: tuple[Part, ...], p: np.ndarray, s: Scenery) -> tuple[np.ndarray, float]:
    """(numbers (P,), Σr²) of a sketch from the numbers p; a new lobe (NaN) begins at the likeliest of some widths."""
    problem = CandidateProblem(parts, s)
    missing = np.isnan(p)
    starts = [p]
    if missing.any():
        new_width = any(u.name.startswith("alpha") for u, yes in zip(problem.numbers, missing, strict=True) if yes)
        starts = []
        for width in WIDTHS if new_width else (NEW["alpha"],):
            new = [
                width * APART.get(u.name, 1.0) if u.name.startswith("alpha") else NEW[u.name] for u in problem.numbers
            ]
            starts.append(np.where(missing, new, p))
        starts = _with_amounts(problem, np.stack(starts))[:REFINED]
    ends = minimise(problem, starts, Stopping(rough=ROUGH, most=STEPS))
    best = min(ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)
    return snapped(problem.domains, best.p), 2.0 * best.cost


def _with_amounts(problem: CandidateProblem, p: np.ndarray) -> list[np.ndarray]:
    """Vectors p (S, P) with their albedos and scales from the data at given shapes, the best first.

    A number that all channels share stays as it is.
    """
    numbers, channels = problem.numbers, problem.scenery.target.shape[1]
    free = [
        [j for j, u in enumerate(numbers) if u.linear and (u.channel == c or channels == 1)] for c in range(channels)
    ]
    size = np.sqrt(np.sum((problem.slope * problem.scenery.f) ** 2, axis=0))
    reach = np.array([size[u.channel or 0] for u in numbers])
    solved = solve_amounts(problem.linearised_equations(p), p, np.array(free, int), reach, problem.domains)
    return [q for q, _ in sorted(solved, key=lambda start: start[1])]
