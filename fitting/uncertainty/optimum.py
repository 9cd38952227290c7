"""The optimum of a fit: where it ended, how stationary it is, and what the data say of each free number there."""

import dataclasses

import numpy as np

from gonio.fitting.problem.domains import Domains, at_bounds
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Parameterisation
from gonio.fitting.problem.problem import Evaluation, FitProblem
from gonio.fitting.problem.readings import Readings
from gonio.fitting.solver.convergence import EXACT, eps, is_exact, stationarity, stationary_limit
from gonio.fitting.solver.robust_weights import DownweightedReadings
from gonio.fitting.uncertainty.covariance import Covariance, CovarianceEstimate, at_bounds_covariance

TOO_FEW = "there are no more readings than free numbers: nothing is left to judge their uncertainty by"


@dataclasses.dataclass(frozen=True)
class Optimum:
    """Statistics at the end of a fit of one problem with P free numbers, n cells and C channels.

    Attributes:
        problem: what was minimised, with its final weights; `parameters` and `domains` of its free numbers.
        p: the free numbers (P,).
        model_f: the model's values (n, C).
        cost: ½ Σ r²; `equations`: normal equations at p.
        covariance: of the free numbers.
        active_bound: which numbers (P,) a bound holds.
        reach: how far inside its bound such a number may lie, with 95 % confidence (P,).
        projected_gradient: see `convergence.stationarity`; up to `limit` it counts as stationary.
        exact: ‖r‖ ≤ 10³ eps ‖data‖: the residual is rounding.
        log_weight: Σ ln w over the readings, what a likelihood adds where weights are the model's; 0 without one.
        starts, agreed: number of descents, and of those that ended here.
        notes: sentences for the result.
        downweighted: what a robust fit counts less.
        profile: 95 % intervals of vague numbers, by index.
        unfollowed: vague numbers whose intervals are those of the covariance matrix all the same.
    """

    problem: FitProblem
    parameters: Parameterisation
    domains: Domains
    p: np.ndarray
    model_f: np.ndarray
    cost: float
    equations: NormalEquations
    covariance: Covariance
    active_bound: np.ndarray
    reach: np.ndarray
    projected_gradient: float
    limit: float
    exact: bool
    log_weight: float
    starts: int
    agreed: int
    notes: list[str]
    downweighted: DownweightedReadings | None = None
    profile: dict[int, tuple[float, float]] = dataclasses.field(default_factory=dict)
    unfollowed: tuple[int, ...] = ()

    @property
    def readings(self) -> Readings:
        """What was fitted."""
        return self.problem.readings

    @property
    def converged(self) -> bool:
        """Stationary or exact, at a finite cost."""
        return bool(np.isfinite(self.cost)) and (self.exact or self.projected_gradient <= self.limit)

    def widened(self, variance: float) -> "Optimum":
        """The same with all variances multiplied."""
        spread = self.covariance.scaled(variance, self.domains, self.p)
        return dataclasses.replace(self, covariance=spread, reach=self.reach * np.sqrt(variance))


def optimum_at(
    problem: FitProblem,
    p: np.ndarray,
    evaluation: Evaluation,
    agreement: tuple[int, int],
    likelihood: bool,
    notes: list[str],
    downweighted: DownweightedReadings | None,
) -> Optimum:
    """The optimum of a problem at p (P,), from its evaluation there; `agreement`: starts, and how many agree."""
    d, count, equations, scores = problem.domains, problem.readings.count, evaluation.equations, evaluation.scores
    measure = stationarity(d, p, equations)
    active, target, cost = measure.active_bound, problem.target_norm_squared, float(equations.cost)
    exact = is_exact(cost, target)
    if exact:
        # The gradient of a rounding residual points anywhere: a bound is active where the number lies on it.
        active = np.logical_or(*at_bounds(d, p))
    notes = list(notes)
    if not likelihood and p.size and count <= p.size and not exact:
        notes.append(TOO_FEW)
        scores = np.full_like(equations.matrix, np.nan)
    estimate = CovarianceEstimate(equations.matrix, None if likelihood else scores, count, d, p)
    spread, active, reach = at_bounds_covariance(estimate, equations.gradient, active, measure.zero_sensitivity)
    if exact and not likelihood:
        # What a fit without residual knows a number to is what it calls a residual of rounding.
        rounding = (EXACT * eps()) ** 2 * target / max(count, 1)
        known = dataclasses.replace(estimate, scores=None)
        spread = known.covariance(~active & ~measure.zero_sensitivity).scaled(rounding, d, p)
    if downweighted is not None:
        spread = spread.scaled(downweighted.widening**2, d, p)
    log_weight = float(np.sum(np.log(problem.weight[problem.weight > 0]))) if likelihood else 0.0
    return Optimum(
        problem, problem.parameters, d, p, evaluation.f, cost, equations, spread, active, reach,
        float(measure.projected_gradient), stationary_limit(cost, target), exact, log_weight, *agreement, notes,
        downweighted,
    )  # fmt: skip
