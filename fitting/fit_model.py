"""One model fitted to readings: starts, descents, polish on all readings, and what can be said of the end."""

import dataclasses
import time

import numpy as np

from gonio.data.layouts import Layout
from gonio.data.table import Channels
from gonio.fitting.assemble_result import state
from gonio.fitting.problem import normal_equations as equations
from gonio.fitting.problem.domains import Domains
from gonio.fitting.problem.loss_floor import loss_floor
from gonio.fitting.problem.normal_equations import Closing, Sums, closing, values
from gonio.fitting.problem.parameterisation import Structure, domains_of, labels, structure_of
from gonio.fitting.problem.readings import Readings, blocked, weights_of
from gonio.fitting.result import FitResult
from gonio.fitting.solver import lm_step as stepping
from gonio.fitting.solver.convergence import EXACT, eps, is_exact, stationary_limit
from gonio.fitting.solver.levenberg_marquardt import Problem, at_bounds, stationarity
from gonio.fitting.solver.multilevel import search
from gonio.fitting.solver.multistart import Descent, descend, ordered_lobes
from gonio.fitting.solver.precompile import ahead, finished
from gonio.fitting.solver.robust_weights import SetAside, robustly
from gonio.fitting.uncertainty.covariance import Covariance, at_their_bounds, covariance
from gonio.models.errors import GonioError
from gonio.models.expression.parser import Term, Value
from gonio.models.expression.paths import changed, last, numbers

REWEIGHTINGS = 30


@dataclasses.dataclass(frozen=True)
class Options:
    """How to fit: loss, standard uncertainties, relative noise, random starts, seed, and what the table was."""

    loss: str
    sigma: np.ndarray | None
    relative_noise: float | None
    starts: int
    seed: int
    theta_max: float | None
    weight: str | None
    table: str
    robust: str | None = None
    bootstrap: int = 0
    bootstrap_kind: str = "residuals"
    counts: dict = dataclasses.field(default_factory=dict)
    layout: Layout | None = None

    @property
    def likelihood(self) -> bool:
        """Whether the cost is the noise's own likelihood: weights by known noise, and by nothing else."""
        return self.loss == "sigma" and self.weight is None and self.robust is None


def _stationary(d: Domains, p: np.ndarray, total: Sums, whole: Problem) -> bool:
    cost, target_norm_squared = float(total.cost), float(whole.target_norm_squared)
    return is_exact(cost, target_norm_squared) or float(stationarity(d, p, total)[0]) <= stationary_limit(
        cost, target_norm_squared
    )


@dataclasses.dataclass(frozen=True)
class Ending:
    """The end of a fit of one structure: its numbers p (P,), and what the sums over all readings say of them."""

    structure: Structure
    fixed: tuple[dict, ...]
    domains: Domains
    p: np.ndarray
    model_f: np.ndarray  # (n, C)
    total: Sums
    covariance: Covariance
    pinned: np.ndarray
    target_norm_squared: float
    log_weight: float  # Σ ln w over the readings: what a likelihood adds where weights are the model's
    stationarity: float
    starts: int
    agreed: int
    notes: list[str]
    problem: Problem
    weight: np.ndarray  # (n, C), of the residuals
    reach: np.ndarray  # (P,) how far inside its bound a pinned number may lie, with 95 % confidence
    aside: SetAside | None = None  # what a robust fit counts less
    profile: dict[int, tuple[float, float]] = dataclasses.field(default_factory=dict)  # 95 % intervals of vague numbers
    unfollowed: tuple[int, ...] = ()  # vague numbers whose intervals are those of the covariance all the same

    @property
    def exact(self) -> bool:
        """‖r‖ ≤ 10³ eps ‖data‖: the residual is rounding."""
        return is_exact(float(self.total.cost), self.target_norm_squared)

    @property
    def converged(self) -> bool:
        """Stationary or exact, at a finite cost."""
        return bool(np.isfinite(float(self.total.cost))) and (self.exact or self.stationarity <= self.limit)

    @property
    def limit(self) -> float:
        """Up to which projected gradient the fit counts as stationary."""
        return stationary_limit(float(self.total.cost), self.target_norm_squared)


def fit_one(
    asked: str, terms: tuple[Term, ...], readings: Readings, channels: Channels, options: Options, per_channel: bool
) -> FitResult:
    """Fit terms (as `with_defaults` gives them) to readings; GonioError where these are too few for the model."""
    began = time.perf_counter()
    _require_lists(asked, terms, len(channels))
    if per_channel and len(channels) > 1:
        endings = []
        for c in range(len(channels)):
            one = dataclasses.replace(options, sigma=None if options.sigma is None else options.sigma[:, c : c + 1])
            endings.append(_end(asked, _of_channel(terms, c), readings.channel(c), (channels.names[c],), one))
    else:
        endings = [_end(asked, terms, readings, channels.names, options)]
    seconds = {"fit": time.perf_counter() - began}
    return state(asked, terms, endings, readings, channels, options, seconds)


def prepare(terms: tuple[Term, ...], loss: str, channels: int, per_channel: bool) -> None:
    """Begin to trace and load, beside other work, what the fit of these terms will need."""
    if per_channel and channels > 1:
        terms, channels = _of_channel(terms, 0), 1
    s, fixed, _ = structure_of(terms, channels)
    if s.size:
        ahead(("step", stepping.padded_size(s.size)), lambda: stepping.prepare(s.size))
    ahead((s, loss), lambda: equations.prepare(s, loss, fixed))


def _require_lists(asked: str, terms: tuple[Term, ...], channels: int) -> None:
    for n in (n for t in terms for n in numbers(t)):
        if isinstance(n.value.number, tuple) and len(n.value.number) != channels:
            raise GonioError(
                f"'{asked}' gives {n.call.name}'s {last(n.path)} {len(n.value.number)} values, but the table has "
                f"{channels} channel{'s' * (channels != 1)}; give one value each, or a single one."
            )


def _of_channel(terms: tuple[Term, ...], c: int) -> tuple[Term, ...]:
    def one(_: str, v: Value) -> Value:
        return dataclasses.replace(v, number=v.number[c]) if isinstance(v.number, tuple) else v

    return tuple(changed(t, one) for t in terms)


def _require_enough(asked: str, s: Structure, readings: Readings, names: tuple[str, ...]) -> None:
    of = labels(s)
    for c, name in enumerate(names):
        wanted = [n for n, channel in of if channel in (c, None)]
        have = int(np.count_nonzero(readings.valid[:, c]))
        if have < len(wanted):
            raise GonioError(
                f"'{asked}' has {len(wanted)} free numbers in channel {name} ({', '.join(wanted)}), and the table has "
                f"{have} valid reading{'s' * (have != 1)} there: {len(wanted) - have} more are needed."
            )


def _end(asked: str, terms, readings: Readings, names: tuple[str, ...], options: Options) -> Ending:
    s, fixed, said = structure_of(terms, len(names))
    _require_enough(asked, s, readings, names)
    d = domains_of(s)
    loss = options.loss
    sigma = (
        options.sigma
        if options.relative_noise is None
        else _relative_sigma(readings, readings.f, options.relative_noise)
    )
    if s.size:
        finished()  # before anything large is laid out: compilers take a lot of memory for a moment
    weight = weights_of(readings, loss, sigma)
    floor = loss_floor(readings, loss)
    notes: list[str] = []

    def problem(part: Readings, w: np.ndarray) -> Problem:
        data, target_norm_squared = blocked(part, loss, w, floor)
        return Problem(s, loss, fixed, d, data, np.asarray(target_norm_squared))

    whole = problem(readings, weight)
    aside = None
    if not s.size:
        last, agreed, number = None, 1, 1
        p = said
    else:
        found = search(asked, problem, whole, said, readings, weight, options.starts, options.seed)
        last, p, number, agreed = found.best, found.best.p, len(found.ends), found.agreed
        if options.relative_noise is not None:
            last, whole, weight = _reweighted(problem, d, readings, last, options, notes)
            p = last.p
        if options.robust is not None:
            last, whole, weight, aside = robustly(
                problem, d, readings, weight, found.cells, found.ends, last, options, notes
            )
            p = last.p
        p = ordered_lobes(s, fixed, _snapped(d, p))
    done = _closing(whole, p)
    if last is not None and last.said_successful and not _stationary(d, p, done.total, whole):
        # The last step was not looked at before, and did not do.
        last = descend(whole, d, p)
        p = ordered_lobes(s, fixed, _snapped(d, last.p))
        done = _closing(whole, p)
    if last is not None and not last.said_successful:
        notes.append("the solver stopped at its step limit")
    return _closed(s, fixed, d, p, done, whole, readings, weight, (number, agreed), options, notes, aside)


def _relative_sigma(readings: Readings, f: np.ndarray, share: float) -> np.ndarray:
    typical = np.median(np.abs(f[readings.valid]))
    return share * np.maximum(np.abs(f), 1e-6 * typical if typical > 0 else 1.0)


def _reweighted(problem, d: Domains, readings: Readings, last: Descent, options: Options, notes: list[str]):
    """Descents with σ from the model's own f, until its numbers settle [iteratively reweighted least squares]."""
    s_problem = None
    for _ in range(REWEIGHTINGS):
        if s_problem is None:
            s_problem = problem(
                readings, weights_of(readings, "sigma", _relative_sigma(readings, readings.f, options.relative_noise))
            )
        f = _model_values(s_problem, last.p, readings)
        weight = weights_of(readings, "sigma", _relative_sigma(readings, f, options.relative_noise))
        s_problem = problem(readings, weight)
        after = descend(s_problem, d, last.p)
        moved = np.max(np.abs(after.p - last.p) / np.maximum(np.abs(after.p), 1e-9))
        last = after
        if moved < 1e-8:
            break
    else:
        notes.append(f"the weights had not settled after {REWEIGHTINGS} rounds: the numbers still moved by {moved:.1g}")
    return last, s_problem, weight


def _model_values(problem: Problem, p: np.ndarray, readings: Readings) -> np.ndarray:
    return values(problem.structure, problem.loss, p, problem.fixed, problem.data)[: readings.f.shape[0]]


def _closing(problem: Problem, p: np.ndarray) -> Closing:
    return closing(problem.structure, problem.loss, p, problem.fixed, problem.data)


def _snapped(d: Domains, p: np.ndarray) -> np.ndarray:
    low, high = at_bounds(d, p)
    return np.where(low, d.low, np.where(high, d.high, p))


def _closed(
    s, fixed, d, p, done: Closing, whole: Problem, readings: Readings, weight, counts, options: Options, notes, aside
) -> Ending:
    f, total = done.f[: readings.f.shape[0]], done.total
    measure, pinned, silent = stationarity(d, p, total)
    exact = is_exact(float(total.cost), float(whole.target_norm_squared))
    if exact:
        # The gradient of a rounding residual points anywhere: a bound is active where the number lies on it.
        low, high = at_bounds(d, p)
        pinned = low | high
    matrix, scatter = total.matrix, done.scatter
    known = options.likelihood
    if not known and s.size and readings.count <= s.size and not exact:
        notes.append("there are no more readings than free numbers: nothing is left to judge their uncertainty by")
        scatter = np.full_like(scatter, np.nan)
    spread, pinned, reach = at_their_bounds(
        total, lambda free: covariance(matrix, scatter, known, free, d, p, readings.count), pinned, silent
    )
    if exact and not known:
        # What a fit without residual knows a number to is what it calls a residual of rounding.
        rounding = (EXACT * eps()) ** 2 * float(whole.target_norm_squared) / max(readings.count, 1)
        free = ~pinned & ~silent
        spread = covariance(matrix, scatter, True, free, d, p, readings.count).scaled(rounding, d, p)
    if aside is not None:
        spread = spread.scaled(aside.widening**2, d, p)
    return Ending(
        s, fixed, d, p, f, total, spread, pinned, float(whole.target_norm_squared),
        float(np.sum(np.log(weight[weight > 0]))) if known else 0.0, float(measure), *counts, notes,
        whole, weight, reach, aside,
    )  # fmt: skip
