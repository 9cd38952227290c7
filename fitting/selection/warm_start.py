"""Starts of a candidate that has grown out of another, and its fit: values are carried over, new ones guessed."""

from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.parameterisation import FreeParameter, snapped
from gonio.fitting.selection.candidate_model import CandidateProblem, Terms, candidate_parameters
from gonio.fitting.solver.levenberg_marquardt import Stopping, minimise
from gonio.fitting.solver.multistart import APART, WIDTHS, solve_amounts
from gonio.models.expression.parser import FACTOR

NEW = {"f0": 0.1, "gamma": 2.2, "r": 0.3, "rho": 0.3, FACTOR: 0.1, "alpha": 0.3, "alpha_x": 0.25, "alpha_y": 0.4}
REFINED = 2
STEPS, ROUGH = 80, 1e4  # of a descent, which ends where a step promises less than 1e-9 of the cost


class Fitted(NamedTuple):
    """The end of a candidate's fit: free numbers p (P,) and χ² = Σr²."""

    p: np.ndarray
    chi2: float


def carried(old: Terms, p: np.ndarray, new: Terms, channels: int) -> np.ndarray:
    """Free numbers (P,) of the terms `new` out of those, p, of the terms `old`, in their order; NaN where none is."""
    before, after = (candidate_parameters(terms, channels).parameterisation for terms in (old, new))
    known = {(g.term, g.path): p[before.of(g)] for g in before.free}

    def values(g: FreeParameter) -> np.ndarray:
        carried = known.get((g.term, g.path))
        if carried is not None and carried.size == after.count(g):
            return carried
        widths = {name: known.get((g.term, name), np.array(np.nan)).mean() for name in ("alpha", "alpha_x", "alpha_y")}
        if carried is not None:
            value = carried.mean()
        elif g.path in APART and np.isfinite(widths["alpha"]):
            value = APART[g.path] * widths["alpha"]
        elif g.path == "alpha" and np.isfinite(widths["alpha_x"]):
            value = np.sqrt(widths["alpha_x"] * widths["alpha_y"])
        else:
            value = np.nan if g.term >= len(old) else NEW[g.path]
        return np.full(after.count(g), value)

    return np.concatenate([values(g) for g in after.free])


def fit_candidate(problem: CandidateProblem, p: np.ndarray) -> Fitted:
    """A candidate fitted from the free numbers p (P,); a new lobe (NaN) starts at the likeliest of some widths."""
    free = problem.parameters.parameterisation
    missing, is_width = np.isnan(p), free.each(lambda g: g.info.role == "width").astype(bool)
    starts = [p]
    if missing.any():
        usual, ratio = free.each(lambda g: NEW[g.path]), free.each(lambda g: APART.get(g.path, 1.0))
        widths = WIDTHS if (missing & is_width).any() else (NEW["alpha"],)
        guesses = [np.where(missing, np.where(is_width, width * ratio, usual), p) for width in widths]
        starts = _with_amounts(problem, np.stack(guesses))[:REFINED]
    ends = minimise(problem, starts, Stopping(rough=ROUGH, most=STEPS))
    best = min(ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)
    return Fitted(snapped(problem.domains, best.p), 2.0 * best.cost)


def _with_amounts(problem: CandidateProblem, p: np.ndarray) -> list[np.ndarray]:
    """Vectors p (S, P) with their albedos and scales from the data at given shapes, the best first.

    A number that all channels share stays as it is.
    """
    free, channels = problem.parameters.parameterisation, problem.data.channels
    unknown = free.each(lambda g: g.linear and (g.per_channel or channels == 1)).astype(bool)
    linear = CandidateProblem(problem.terms, problem.data.with_linear_loss())
    size = np.sqrt(np.sum((linear.data.weight * linear.data.f) ** 2, axis=0))
    reach = np.concatenate([size[: free.count(g)] for g in free.free])
    solved = solve_amounts(linear.normal_equations(p), free.order, p, unknown, reach, problem.domains)
    return [q for q, _ in sorted(solved, key=lambda start: start[1])]
