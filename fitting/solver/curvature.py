"""The last steps of a fit that leaves much, with the curvature of its residuals, which Gauss–Newton steps leave out.

Where no model fits, Σ r ∂²r is as large as JᵀJ: steps then shrink by a few per cent each, or turn to and fro [Dennis,
Gay & Welsch 1981]. Near the end that sum hardly changes any more. It is measured by differences of the gradient.
"""

import dataclasses

import numpy as np

from gonio.fitting.problem.arrow import WHOLE, Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains
from gonio.fitting.problem.readings import LANES
from gonio.fitting.solver.levenberg_marquardt import NEAR, Descent, LeastSquares, minimise
from gonio.fitting.solver.lm_step import stationarity

STEP = 1e-4  # of the change of a number that alone changes the residuals by as much as there is
ROUNDS = 3
SHARES = (1.0, 0.5, 0.25, 0.125)  # of the curvature: the largest is taken that leaves a minimum
LEFT = 0.1  # of the smallest eigenvalue without the curvature


@dataclasses.dataclass(frozen=True)
class _Curved:
    """A least-squares problem whose Hessian has a constant matrix `curvature` (P, P) added, in the arrow's order."""

    problem: LeastSquares
    curvature: np.ndarray

    @property
    def domains(self) -> Domains:
        return self.problem.domains

    @property
    def linear(self) -> np.ndarray:
        return self.problem.linear

    @property
    def order(self) -> np.ndarray:
        return self.problem.order

    @property
    def target_norm_squared(self) -> float:
        return self.problem.target_norm_squared

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None) -> NormalEquations:
        equations = self.problem.normal_equations(p, active)
        return equations._replace(matrix=Arrow.dense(equations.matrix.whole() + self.curvature))


def completed(problem: LeastSquares, end: Descent) -> Descent:
    """A descent that was not yet at its end, gone on with to it; the same where numbers are many or this is no help.

    Args:
        problem: what is minimised.
        end: where Gauss–Newton steps have come.
    """
    for _ in range(ROUNDS):
        curvature = _curvature(problem, end.p)
        if curvature is None:
            break
        further = minimise(_Curved(problem, curvature), [end.p], NEAR)[0]
        if not further.cost <= end.cost:
            break
        end = further
        if end.successful:
            break
    return end


def _curvature(problem: LeastSquares, p: np.ndarray) -> np.ndarray | None:
    """Σ r ∂²r (P, P) at p, in the arrow's order, or a share of it; None where there is none to use."""
    order = problem.order
    if order.size > WHOLE:
        return None
    here = problem.normal_equations(p[None])
    d = Domains(*(a[order] for a in problem.domains))
    measure = stationarity(d, p[None, order], here)
    kept = ~(measure.active_bound | measure.zero_sensitivity)[0]
    matrix = here.matrix.whole()[0]
    lengths = np.sqrt(np.where(kept, np.diagonal(matrix), 1.0))
    reach = STEP * np.sqrt(2.0 * float(here.cost[0])) / lengths
    ends = [np.clip(p[order] + sign * reach, d.low, d.high) for sign in (1.0, -1.0)]
    index, spans = np.flatnonzero(kept), ends[0] - ends[1]
    if not spans[kept].all():  # nothing is left to explain, or no room to look around
        return None
    points = np.repeat(p[None], 2 * index.size, axis=0)
    for k, (place, changed) in enumerate((i, e[i]) for i in index for e in ends):
        points[k, order[place]] = changed
    parts = range(0, len(points), LANES)
    gradient = np.concatenate([problem.normal_equations(points[k : k + LANES]).gradient for k in parts])
    hessian = np.zeros_like(matrix)
    hessian[index] = (gradient[::2] - gradient[1::2]) / spans[index, None]
    both = np.outer(kept, kept)
    curvature = np.where(both, (hessian + hessian.T) / 2 - matrix, 0.0)
    scale = np.outer(lengths, lengths)[both]
    unit, bent = ((a[both] / scale).reshape(index.size, index.size) for a in (matrix, curvature))
    if not (index.size and np.isfinite(bent).all()):
        return None
    least = LEFT * max(float(np.linalg.eigvalsh(unit)[0]), 0.0)
    usable = (s for s in SHARES if np.linalg.eigvalsh(unit + s * bent)[0] > least)
    share = next(usable, None)
    return None if share is None else share * curvature
