"""The optimum of a fit: how stationary it is, and the covariance of its free numbers with what it leaves open."""

import dataclasses
import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from gonio.data.table import Channels
from gonio.fitting.problem.parameterisation import LINEAR, LOG, Domains, Parameterisation, at_bounds
from gonio.fitting.problem.problem import Evaluation, FitProblem, NormalEquations
from gonio.fitting.problem.readings import Readings
from gonio.fitting.solver.levenberg_marquardt import EXACT, eps, is_exact, stationarity, stationary_limit
from gonio.fitting.solver.robust_weights import DownweightedReadings

TOO_FEW = "there are no more readings than free numbers: nothing is left to judge their uncertainty by"

NORMAL_95 = 1.959963984540054
LOST = 1e-13  # eigenvalue of the scaled normal matrix below which double precision sees a combination as free
LOST_ROUNDINGS = 100.0  # the same in other precisions
FACTOR_OPEN = 2.0  # a number is open where its 95 % interval spans its domain, or a factor of e to this power
PUSHED = 2.0  # standard uncertainties beyond its bound, from which on a number belongs there
WIDE_OPEN = 2.0 * math.tanh(FACTOR_OPEN / 2)  # length of the interval [p(1 − t), p(1 + t)] over p, with that ratio
FOLLOWS = 0.9  # share of a number's variance that comes from an open combination, from which on it is open with it
FOLLOWED = 0.15  # of the standard uncertainty that counts as open, from which on the profile is followed
ALONG = 0.95  # correlation of numbers that go together
VAGUE = 0.15  # where it also has at least this relative uncertainty


@dataclasses.dataclass(frozen=True)
class Covariance:
    """Covariance (P, P) of the free numbers: NaN rows where a bound holds a number, or without visible effect.

    `undetermined` (P,): numbers that the data leave open. `combinations` are (variance, change (P,)): a change of the
    numbers that is as large as what counts as open, and its variance in units of that change's square: at least 1, and
    infinite where double precision sees no effect of it at all.
    """

    matrix: np.ndarray
    undetermined: np.ndarray
    combinations: list[tuple[float, np.ndarray]]

    @property
    def standard(self) -> np.ndarray:
        """Standard uncertainties (P,)."""
        return np.sqrt(np.diagonal(self.matrix))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (P, P)."""
        with np.errstate(invalid="ignore"):
            return self.matrix / np.outer(self.standard, self.standard)

    def scaled(self, variance: float, d: Domains, p: np.ndarray) -> "Covariance":
        """The same with all variances multiplied, and open numbers decided again."""
        lost = [(v, change) for v, change in self.combinations if not np.isfinite(v)]
        unseen = self.undetermined & np.isnan(np.diagonal(self.matrix))
        return judged(self.matrix * variance, unseen, lost, d, p)


@dataclasses.dataclass(frozen=True)
class CovarianceEstimate:
    """What a covariance is made of: JᵀJ (P, P), the score covariance or None where the noise is known, domains, p.

    With noise known it is (JᵀJ)⁻¹; else the heteroscedasticity-consistent (JᵀJ)⁻¹ Jᵀdiag(r²)J (JᵀJ)⁻¹ [White 1980] with
    its small-sample factor n/(n − P): the noise of a BRDF is rarely even in a loss. `residuals` is n.
    """

    matrix: np.ndarray
    scores: np.ndarray | None
    residuals: int
    domains: Domains
    p: np.ndarray

    def covariance(self, free: np.ndarray) -> Covariance:
        """Covariance of the numbers that are `free` (P,): not held by a bound, and with an effect on the residuals."""
        size, matrix = self.p.size, self.matrix
        full = np.full((size, size), np.nan)
        silent = ~np.asarray(free, bool) & (np.diagonal(matrix) <= 0)
        index = np.flatnonzero(free)
        if not index.size:
            return Covariance(full, silent, [])
        lengths = np.sqrt(np.diagonal(matrix)[index])
        scaled = matrix[np.ix_(index, index)] / np.outer(lengths, lengths)
        values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
        lost = values < max(LOST, LOST_ROUNDINGS * eps()) * index.size
        inverse = (vectors[:, ~lost] / values[~lost]) @ vectors[:, ~lost].T
        inverse = inverse / np.outer(lengths, lengths)
        if self.scores is not None:
            small = self.residuals / max(self.residuals - int(index.size), 1)
            inverse = inverse @ self.scores[np.ix_(index, index)] @ inverse * small
        touched = (np.abs(vectors[:, lost]) > 0.1).any(axis=1)
        inverse[touched, :] = inverse[:, touched] = np.nan
        full[np.ix_(index, index)] = inverse
        combinations, reach = [], open_from(self.domains, self.p)
        for vector in _sparse(vectors[:, lost]).T:
            change = np.zeros(size)
            change[index] = vector / lengths
            combinations.append((np.inf, change / np.max(np.abs(change) / reach)))
        unseen = silent.copy()
        unseen[index[touched]] = True
        return judged(full, unseen, combinations, self.domains, self.p)


def judged(
    full: np.ndarray, unseen: np.ndarray, lost: list[tuple[float, np.ndarray]], d: Domains, p: np.ndarray
) -> Covariance:
    """The covariance with what it leaves open: each number by itself, and the combinations that they are open along."""
    undetermined, combinations = unseen.copy(), list(lost)
    index = np.flatnonzero(np.isfinite(np.diagonal(full)))
    reach = open_from(d, p)[index]
    scaled = full[np.ix_(index, index)] / np.outer(reach, reach)
    if index.size and np.isfinite(scaled).all() and (np.diagonal(scaled) > 1).any():
        undetermined[index[np.diagonal(scaled) > 1]] = True
        values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
        for k in np.flatnonzero(values > 1)[::-1]:
            change = np.zeros(p.size)
            change[index] = vectors[:, k] * reach
            combinations.append((float(values[k]), change))
            follows = values[k] * vectors[:, k] ** 2 > FOLLOWS * np.diagonal(scaled)
            vague = np.sqrt(np.diagonal(scaled)) * reach > VAGUE * np.abs(p[index])
            undetermined[index[follows & vague]] = True
    return Covariance(full, undetermined, combinations)


def _sparse(vectors: np.ndarray) -> np.ndarray:
    """Another basis (P, L) of the space that the columns span, in reduced echelon form: few numbers in each."""
    rows = vectors.T.copy()
    for r in range(rows.shape[0]):
        i, j = np.unravel_index(np.argmax(np.abs(rows[r:])), rows[r:].shape)
        rows[[r, r + i]] = rows[[r + i, r]]
        rows[r] /= rows[r, j]
        for other in range(rows.shape[0]):
            if other != r:
                rows[other] -= rows[other, j] * rows[r]
    return np.where(np.abs(rows) < 1e-6, 0.0, rows).T


def open_from(d: Domains, p: np.ndarray) -> np.ndarray:
    """Standard uncertainties (P,) from which on numbers count as open.

    The 95 % interval then spans the domain, or a factor of e² (±76 % of the number); where a fit does not step in its
    logarithm also no less than 1, so that a small albedo is known to be small.
    """
    low, high, kind = (np.asarray(a) for a in (d.low, d.high, d.kind))
    shift = np.where(kind == LOG, 0.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.where(kind == LINEAR, 0.0, np.log((high + shift) / (np.where(kind == LOG, low, 0.0) + shift)))
    curved = np.minimum(width, FACTOR_OPEN) * np.where(kind == LOG, np.maximum(np.abs(p), low), np.abs(p) + shift)
    straight = np.minimum(high - low, np.maximum(WIDE_OPEN * np.abs(p), 1.0))
    return np.where(kind == LINEAR, straight, curved) / (2 * NORMAL_95)


class BoundedCovariance(NamedTuple):
    """Covariance, which numbers (P,) a bound holds, how far inside of it they may lie with 95 % confidence (P,)."""

    covariance: Covariance
    active_bound: np.ndarray
    reach: np.ndarray


def at_bounds_covariance(
    estimate: CovarianceEstimate, gradient: np.ndarray, active_bound: np.ndarray, zero_sensitivity: np.ndarray
) -> BoundedCovariance:
    """The covariance with bounds: a number counts as free where it pushes against its bound no more than noise does.

    That is so where it would be open without the bound: others that go with it would seem to be known.
    """
    active, reach = active_bound.copy(), np.full(active_bound.size, np.nan)
    spread = estimate.covariance(~active & ~zero_sensitivity)
    for k in np.flatnonzero(active & ~zero_sensitivity).tolist():
        free = ~active & ~zero_sensitivity
        others = np.flatnonzero(free)
        free[k] = True
        around = estimate.covariance(free)
        if around.undetermined[k] and np.isnan(around.matrix[k, k]):
            reach[k] = np.inf
            continue
        beyond, limit = beyond_bound(estimate.matrix, gradient, around.matrix, k, others)
        if around.undetermined[k] and beyond < PUSHED:
            active[k], spread = False, around
        else:
            reach[k] = limit
    return BoundedCovariance(spread, active, reach)


def beyond_bound(
    matrix: np.ndarray, gradient: np.ndarray, spread: np.ndarray, index: int, others: np.ndarray
) -> tuple[float, float]:
    """Of a number on its bound: how far beyond it the cost has its minimum, in standard uncertainties u; and how far
    inside of it the number may lie with 95 % confidence.

    Without the bound the quadratic cost has its minimum a distance m beyond it: the limit is the 95 % point of that
    normal law cut off at the bound. `spread` is the covariance (P, P) with the number `at` let free beside the `others`
    (indices).
    """
    free = np.append(others, index)
    u = float(np.sqrt(spread[index, index]))
    if not (np.isfinite(u) and u > 0):
        return float("nan"), float("nan")
    lengths = np.sqrt(np.maximum(np.diagonal(matrix)[free], 1e-300))
    scaled = matrix[np.ix_(free, free)] / np.outer(lengths, lengths)
    step = -np.linalg.lstsq(scaled, gradient[free] / lengths, rcond=1e-12)[0] / lengths
    beyond = abs(float(step[-1])) / u
    if beyond > 30:
        return beyond, 3.0 * u / beyond  # the normal tail is an exponential there: ln 20 · u²/m
    return beyond, -u * (beyond + NormalDist().inv_cdf(0.025 * math.erfc(beyond / math.sqrt(2.0))))


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
        cost: ½ Σ r²; `equations`: normal equations at p.
        covariance: of the free numbers.
        active_bound: which numbers (P,) a bound holds.
        reach: how far inside its bound such a number may lie, with 95 % confidence (P,).
        projected_gradient: see `stationarity`; up to `limit` it counts as stationary.
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

    def vague_numbers(self) -> list[int]:
        """Numbers whose intervals the covariance may not describe, the vaguest first; none away from a minimum."""
        if self.exact or not self.converged:
            return []
        u, reach = self.covariance.standard, open_from(self.domains, self.p)
        with np.errstate(invalid="ignore"):
            vague = (u > FOLLOWED * reach) & ~self.active_bound
            # What goes with a vague number is as vague in its own size, however small that is beside its domain.
            along = np.abs(self.covariance.correlation) > ALONG
            along = along[:, vague].any(axis=1) & (u > FOLLOWED * np.abs(self.p) / 2)
        indices = np.flatnonzero(vague | (along & ~self.active_bound))
        return [int(k) for k in indices[np.argsort(-(u / reach)[indices])]]

    def estimates(self, channels: Channels, only: str | None) -> list[ParameterEstimate]:
        """Estimates of the free numbers, of all channels or of the channel `only`."""
        infos, estimates = self.parameters.each(lambda g: g.info), []
        for k, (name, c) in enumerate(self.parameters.labels):
            value, u = float(self.p[k]), float(self.covariance.standard[k])
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
                lost = self.covariance.undetermined[k] or not np.isfinite(u)
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
    measure = stationarity(d, p, equations)
    active, target, cost = measure.active_bound, problem.target_norm_squared, float(equations.cost)
    exact, limit = is_exact(cost, target), stationary_limit(cost, target)
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
        float(measure.projected_gradient), limit, exact, log_weight, *agreement, notes,
        downweighted,
    )  # fmt: skip
