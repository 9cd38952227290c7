"""The optimum of a fit: how stationary it is, and the covariance of its free numbers with what it leaves open."""

import dataclasses
import functools

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.problem.arrow import Arrow
from gonio.fitting.problem.normal_equations import Evaluation
from gonio.fitting.problem.parameterisation import Domains, Parameterisation, at_bounds
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import Readings
from gonio.fitting.solver.disc_choice import DiscAverages
from gonio.fitting.solver.lm_step import EXACT, eps, is_exact, stationarity, stationary_limit
from gonio.fitting.solver.robust_weights import DownweightedReadings
from gonio.fitting.uncertainty.covariance import NORMAL_95, open_from
from gonio.fitting.uncertainty.joint_covariance import Combination, JointCovariance, JointEstimate

TOO_FEW = "there are no more readings than free numbers: nothing is left to judge their uncertainty by"

FOLLOWED = 0.15  # of the standard uncertainty that counts as open, from which on the profile is followed
ALONG = 0.95  # correlation of numbers that go together


@dataclasses.dataclass(frozen=True)
class ParameterEstimate:
    """One fitted number. `status`: determined, undetermined, at lower bound, at upper bound, or fixed."""

    name: str
    channel: str | None
    value: float
    standard_uncertainty: float
    interval95: tuple[float, float]
    status: str
    unit: str
    low: float
    high: float

    @property
    def label(self) -> str:
        """Name with its channel, such as ``lambert.rho[R]``."""
        return self.name if self.channel is None else f"{self.name}[{self.channel}]"


@dataclasses.dataclass(frozen=True)
class Optimum:
    """Statistics at the end of a fit of one problem with P free numbers, n cells and C channels.

    Attributes:
        problem: what was minimised, with its final weights; `parameters` and `domains` of its free numbers.
        p: the free numbers (P,).
        model_f: the model's values (n, C).
        cost: ½ Σ r².
        covariance: of the free numbers.
        active_bound: which numbers (P,) a bound holds.
        reach: how far inside its bound such a number may lie, with 95 % confidence (P,).
        projected_gradient: see `stationarity`; up to `limit` it counts as stationary.
        exact: ‖r‖ ≤ 10³ eps ‖data‖: the residual is rounding.
        log_weight: Σ ln w over the readings, what a likelihood adds where weights are the model's; 0 without one.
        starts, agreed: number of descents, and of those that ended here.
        notes: sentences for the result.
        downweighted: what a robust fit counts less.
        averages: how the model was averaged over the discs of the apertures, or what not to do so shifts.
        profile: 95 % intervals of vague numbers, by index.
        unfollowed: vague numbers whose intervals are those of the covariance matrix all the same.
    """

    problem: FitProblem
    parameters: Parameterisation
    domains: Domains
    p: np.ndarray
    model_f: np.ndarray
    cost: float
    covariance: JointCovariance
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
    averages: DiscAverages | None = None

    @property
    def readings(self) -> Readings:
        """What was fitted."""
        return self.problem.readings

    @property
    def converged(self) -> bool:
        """Stationary or exact, at a finite cost."""
        return bool(np.isfinite(self.cost)) and (self.exact or self.projected_gradient <= self.limit)

    @functools.cached_property
    def combinations(self) -> list[Combination]:
        """Open combinations of numbers."""
        return self.covariance.combinations(self.domains, self.p)

    def widened(self, variance: float) -> "Optimum":
        """The same with all variances multiplied."""
        spread = self.covariance.scaled(variance, self.domains, self.p)
        return dataclasses.replace(self, covariance=spread, reach=self.reach * np.sqrt(variance))

    def vague_numbers(self) -> list[int]:
        """Numbers whose intervals the covariance may not describe, the vaguest first; none away from a minimum."""
        if self.exact or not self.converged:
            return []
        u, reach = self.covariance.standard, open_from(self.domains, self.p)
        with np.errstate(invalid="ignore"):
            vague = (u > FOLLOWED * reach) & ~self.active_bound
            # What goes with a vague number is as vague in its own size, however small that is beside its domain.
            along = self.covariance.along(vague, ALONG) & (u > FOLLOWED * np.abs(self.p) / 2)
        indices = np.flatnonzero(vague | (along & ~self.active_bound))
        return [int(k) for k in indices[np.argsort(-(u / reach)[indices])]]

    def estimates(self, channels: Channels, only: str | None) -> list[ParameterEstimate]:
        """Estimates of the free numbers, of all channels or of the channel `only`."""
        infos, standard, estimates = self.parameters.each(lambda g: g.info), self.covariance.standard, []
        undetermined = self.covariance.undetermined
        for k, (name, c) in enumerate(self.parameters.labels):
            value, u = float(self.p[k]), float(standard[k])
            u = max(u, float(np.finfo(float).eps) * abs(value)) if np.isfinite(u) else u
            low, high = float(self.domains.low[k]), float(self.domains.high[k])
            spread = NORMAL_95 * u if np.isfinite(u) else np.inf
            interval = self.profile.get(k, (max(low, value - spread), min(high, value + spread)))
            if self.active_bound[k]:
                inside = self.reach[k] if np.isfinite(self.reach[k]) else high - low
                lower = value - low <= high - value
                status = "at lower bound" if lower else "at upper bound"
                interval = (value, min(high, value + inside)) if lower else (max(low, value - inside), value)
            else:
                lost = undetermined[k] or not np.isfinite(u)
                status = "undetermined" if lost else "determined"
            channel = only or (None if c is None else channels.names[c])
            estimates.append(ParameterEstimate(name, channel, value, u, interval, status, infos[k].unit, low, high))
        return estimates


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
    order = problem.order
    measure = stationarity(Domains(*(a[order] for a in d)), p[order], equations)
    active, silent = np.zeros(p.size, bool), np.zeros(p.size, bool)
    active[order], silent[order] = measure.active_bound, measure.zero_sensitivity
    target, cost = problem.target_norm_squared, float(equations.cost)
    exact, limit = is_exact(cost, target), stationary_limit(cost, target)
    if exact:
        # The gradient of a rounding residual points anywhere: a bound is active where the number lies on it.
        active = np.logical_or(*at_bounds(d, p))
    notes = list(notes)
    if not likelihood and p.size and count <= p.size and not exact:
        notes.append(TOO_FEW)
        scores = Arrow(*(np.full_like(a, np.nan) for a in equations.matrix))
    estimate = JointEstimate(equations, None if likelihood else scores, count, d, p, order)
    spread, active, reach = estimate.with_bounds(active, silent)
    if exact and not likelihood:
        # What a fit without residual knows a number to is what it calls a residual of rounding.
        rounding = (EXACT * eps()) ** 2 * target / max(count, 1)
        known = dataclasses.replace(estimate, scores=None)
        spread = known.covariance(~active & ~silent).scaled(rounding, d, p)
    if downweighted is not None:
        spread = spread.scaled(downweighted.widening**2, d, p)
    log_weight = _log_weight(problem) if likelihood else 0.0
    return Optimum(
        problem, problem.parameters, d, p, evaluation.f, cost, spread, active, reach,
        float(measure.projected_gradient), limit, exact, log_weight, *agreement, notes,
        downweighted,
    )  # fmt: skip


def _log_weight(problem: FitProblem) -> float:
    """Sum of the logarithms of those weights that are not 0."""
    total = 0.0
    for weight in problem.weights():
        total += float(np.sum(np.log(weight, where=weight > 0, out=np.zeros(weight.shape))))
    return total
