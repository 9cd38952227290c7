"""Starts of a candidate that has grown out of another, and its fit: values are carried over, new ones guessed."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.parameterisation import FreeParameter, snapped
from gonio.fitting.selection.candidate_columns import candidate_parameters
from gonio.fitting.selection.candidate_model import CandidateProblem, sums_together
from gonio.fitting.selection.term_spec import Terms
from gonio.fitting.solver.levenberg_marquardt import Stopping
from gonio.fitting.solver.multistart import APART, WIDTHS, solve_amounts
from gonio.fitting.solver.side_by_side import minimise_all
from gonio.models.expression.parser import FACTOR

GUESSES = {
    "eta": (1.5, 0.3, 2.5), "k": (2.5, 5.0), "n": (5.0, 30.0, 200.0), "b": (10.0, 1e3), "l": (0.01, 0.1, 0.4),
    "gamma": (2.2,), "f0": (0.1,), "r": (0.3,), "rho": (0.3,), FACTOR: (0.1,),
}  # fmt: skip
"""Where a shape that nothing is known of begins; other names begin where a fit of their model does."""
REFINED = 2
STEPS, ROUGH = 80, 1e4  # of a descent: its most steps, and how much nearer than this to a minimum it need not end


class Fitted(NamedTuple):
    """The end of a candidate's fit: free numbers p (P,) and χ² = Σr²."""

    p: np.ndarray
    chi2: float


def carried(old: Terms, p: np.ndarray, new: Terms, channels: int) -> np.ndarray:
    """Free numbers (P,) of the terms `new` out of those, p, of the terms `old`, in their order; NaN where none is."""
    before, after = (candidate_parameters(terms, channels).parameterisation for terms in (old, new))
    origin = _origins(old, new)
    known = {(g.term, g.path): p[before.of(g)] for g in before.free}

    def values(g: FreeParameter) -> np.ndarray:
        term = origin.get(g.term, -1)
        carried = known.get((term, g.path))
        if carried is not None and carried.size == after.count(g):
            return carried
        widths = {name: known.get((term, name), np.array(np.nan)).mean() for name in ("alpha", "alpha_x", "alpha_y")}
        if carried is not None:
            value = carried.mean()
        elif g.path in APART and np.isfinite(widths["alpha"]):
            value = APART[g.path] * widths["alpha"]
        elif g.path == "alpha" and np.isfinite(widths["alpha_x"]):
            value = np.sqrt(widths["alpha_x"] * widths["alpha_y"])
        else:
            value = np.nan
        return np.full(after.count(g), value)

    return np.concatenate([np.empty(0), *(values(g) for g in after.free)])


def _origins(old: Terms, new: Terms) -> dict[int, int]:
    """Which old term each new one comes from: an equal one, or else the one in its place."""
    origin: dict[int, int] = {}
    for j, term in enumerate(new):
        equal = [i for i, other in enumerate(old) if other == term and i not in origin.values()]
        origin |= {j: equal[0]} if equal else {}
    if len(old) == len(new):
        origin |= {j: j for j in range(len(new)) if j not in origin and j not in origin.values()}
    return origin


def fit_candidate(problem: CandidateProblem, p: np.ndarray) -> Fitted:
    """A candidate fitted from the free numbers p (P,); see `fit_candidates`."""
    return fit_candidates([problem], [p])[0]


def fit_candidates(
    problems: Sequence[CandidateProblem], numbers: Sequence[np.ndarray], enough: float = 0.0, refined: int = REFINED
) -> list[Fitted]:
    """Candidates fitted side by side to the same readings.

    Args:
        problems: the candidates.
        numbers: of each its free numbers (P,); what is NaN starts at the `refined` likeliest of some guesses.
        enough: a descent ends where its next step promises to lower ½χ² by less.
        refined: how many starts each has.
    """
    starts = [_starts(problem, p, refined) for problem, p in zip(problems, numbers, strict=True)]
    every = minimise_all(problems, starts, Stopping(rough=ROUGH, most=STEPS, enough=enough), sums_together)
    fitted = []
    for problem, p, ends in zip(problems, numbers, every, strict=True):
        if not ends:
            fitted.append(Fitted(p, float(np.sum(problem.residuals(p)[0] ** 2))))
            continue
        best = min(ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)
        fitted.append(Fitted(snapped(problem.domains, best.p), 2.0 * best.cost))
    return fitted


def _starts(problem: CandidateProblem, p: np.ndarray, refined: int) -> list[np.ndarray]:
    """Where a candidate's descents begin; nowhere without a free number."""
    if np.isnan(p).any():
        return _with_amounts(problem, np.stack(guesses(problem, p)))[:refined]
    return [p] if p.size else []


def guesses(problem: CandidateProblem, p: np.ndarray) -> list[np.ndarray]:
    """Vectors (P,) of free numbers whose missing shapes (NaN) lie on a small grid."""
    free, (_, low, high) = problem.parameters.parameterisation, problem.domains
    missing = [g for g in free.free if np.isnan(p[g.first])]
    choices = []
    for g in missing:
        if g.info.role == "width":
            choices.append(tuple(width * APART.get(g.path, 1.0) for width in WIDTHS))
        else:
            choices.append(GUESSES.get(g.path, (g.info.start,)))
    filled = []
    for choice in itertools.product(*choices):
        q = p.copy()
        for g, value in zip(missing, choice, strict=True):
            q[free.of(g)] = value
        filled.append(np.clip(q, low, high))
    return filled


def _with_amounts(problem: CandidateProblem, p: np.ndarray) -> list[np.ndarray]:
    """Vectors p (S, P) with their albedos and scales from the data at given shapes, the best first.

    A number that all channels share stays as it is.
    """
    free, channels = problem.parameters.parameterisation, problem.data.channels
    unknown = free.each(lambda g: g.linear and (g.per_channel or channels == 1)).astype(bool)
    linear = CandidateProblem(problem.terms, problem.data.linearised)
    size = np.sqrt(np.sum((linear.data.weight * linear.data.f) ** 2, axis=0))
    reach = np.concatenate([size[: free.count(g)] for g in free.free])
    solved = solve_amounts(linear.normal_equations(p), free.order, p, unknown, reach, problem.domains)
    return [q for q, _ in sorted(solved, key=lambda start: start[1])]
