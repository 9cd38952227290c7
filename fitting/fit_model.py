"""One model fitted to readings: starts, descents, polish on all readings, and the statistics at the optimum."""

import dataclasses

import numpy as np

from gonio.data.layouts import Layout
from gonio.data.table import Channels
from gonio.fitting.options import FitSettings
from gonio.fitting.problem.domains import snapped
from gonio.fitting.problem.losses import loss_floor, relative_sigma, residual_weights
from gonio.fitting.problem.normal_equations import compile_page_program
from gonio.fitting.problem.parameterisation import Parameterisation, of_channel, parameters
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import Readings
from gonio.fitting.solver.convergence import is_exact, stationarity, stationary_limit
from gonio.fitting.solver.levenberg_marquardt import NEAR, Descent, minimise
from gonio.fitting.solver.lm_step import compile_step, padded_size
from gonio.fitting.solver.multistart import search
from gonio.fitting.solver.precompile import ahead, finished
from gonio.fitting.solver.robust_weights import ROUNDS, robust_fit
from gonio.fitting.uncertainty.optimum import Optimum, optimum_at
from gonio.models.errors import GonioError
from gonio.models.expression.parser import Term
from gonio.models.expression.paths import last, numbers

REWEIGHTINGS = 30
SETTLED = 1e-8  # relative change of the numbers from which on relative weights have settled


@dataclasses.dataclass(frozen=True)
class FitTask:
    """One model to fit to the readings of one table.

    Attributes:
        requested: the expression as it was given.
        terms: the same as `with_defaults` completes it.
        readings: n cells of C channels.
        loss: resolved loss.
        sigma: standard uncertainties (n, C) of the loss `sigma`, or None.
        weight: name of the weights of the cells, or None.
        channels, layout, table: of the table that was read, and its name.
        counts: readings of the table by what became of them.
        settings: the options.
    """

    requested: str
    terms: tuple[Term, ...]
    readings: Readings
    loss: str
    sigma: np.ndarray | None
    weight: str | None
    channels: Channels
    layout: Layout
    table: str
    counts: dict[str, int]
    settings: FitSettings

    @property
    def likelihood(self) -> bool:
        """Whether the cost is the noise's own likelihood: weighted by known noise, and by nothing else."""
        return self.loss == "sigma" and self.weight is None and self.settings.robust is None

    def channel(self, c: int) -> "FitTask":
        """The same task in one channel."""
        return dataclasses.replace(
            self,
            terms=of_channel(self.terms, c),
            readings=self.readings.channel(c),
            sigma=None if self.sigma is None else self.sigma[:, c : c + 1],
            channels=Channels((self.channels.names[c],)),
        )


def compile_ahead(terms: tuple[Term, ...], loss: str, channels: int, per_channel: bool) -> None:
    """Begin to trace and load, beside other work, what the fit of these terms will need."""
    if per_channel and channels > 1:
        terms, channels = of_channel(terms, 0), 1
    s, fixed, _ = parameters(terms, channels)
    if s.size:
        ahead(("step", padded_size(s.size)), lambda: compile_step(s.size))
    ahead((s, loss), lambda: compile_page_program(s, loss, fixed))


def fit_model(task: FitTask) -> list[Optimum]:
    """The joint optimum of all channels, or one for each; GonioError where readings are too few for the model."""
    channels = len(task.channels)
    for n in (n for t in task.terms for n in numbers(t)):
        if isinstance(n.value.number, tuple) and len(n.value.number) != channels:
            raise GonioError(
                f"'{task.requested}' gives {n.call.name}'s {last(n.path)} {len(n.value.number)} values, but the table "
                f"has {channels} channel{'s' * (channels != 1)}; give one value each, or a single one."
            )
    if task.settings.per_channel and channels > 1:
        return [_optimum(task.channel(c)) for c in range(channels)]
    return [_optimum(task)]


def _optimum(task: FitTask) -> Optimum:
    s, fixed, given = parameters(task.terms, len(task.channels))
    _require_enough(task, s)
    readings, settings = task.readings, task.settings
    share = settings.relative_noise
    sigma = task.sigma if share is None else relative_sigma(readings, readings.f, share)
    if s.size:
        finished()  # before anything large is laid out: compilers take a lot of memory for a moment
    weight, floor = residual_weights(readings, task.loss, sigma), loss_floor(readings, task.loss)
    problem, notes = FitProblem.create(s, fixed, task.loss, readings, weight, floor), []
    if not s.size:
        return optimum_at(problem, given, problem.evaluate(given), (1, 1), task.likelihood, notes, None)
    starts = search(problem, given, settings.starts, settings.seed)
    if starts is None:
        raise GonioError(
            f"'{task.requested}' has no finite value at any start on these readings; hold a number with name=value, or "
            "begin elsewhere with name~value."
        )
    end, downweighted = starts.best, None
    if share is not None:
        end, problem = _reweighted(problem, end, share, notes)
    if settings.robust is not None:
        robust = robust_fit(problem, settings.robust, starts.cells, [end, *starts.ends])
        end, problem, downweighted = robust.descent, robust.problem, robust.downweighted
        if not robust.settled:
            notes.append(f"the robust weights had not settled after {ROUNDS} rounds")
    p = s.with_ordered_lobes(fixed, snapped(problem.domains, end.p))
    evaluation = problem.evaluate(p)
    cost, target = float(evaluation.equations.cost), problem.target_norm_squared
    gradient = float(stationarity(problem.domains, p, evaluation.equations).projected_gradient)
    if end.successful and not (is_exact(cost, target) or gradient <= stationary_limit(cost, target)):
        # The last step was not evaluated before, and did not do.
        end = minimise(problem, [p], NEAR)[0]
        p = s.with_ordered_lobes(fixed, snapped(problem.domains, end.p))
        evaluation = problem.evaluate(p)
    if not end.successful:
        notes.append("the solver stopped at its step limit")
    agreement = (len(starts.ends), starts.agreed)
    return optimum_at(problem, p, evaluation, agreement, task.likelihood, notes, downweighted)


def _require_enough(task: FitTask, s: Parameterisation) -> None:
    labels = s.labels()
    for c, name in enumerate(task.channels.names):
        wanted = [n for n, channel in labels if channel in (c, None)]
        have = int(np.count_nonzero(task.readings.valid[:, c]))
        if have < len(wanted):
            raise GonioError(
                f"'{task.requested}' has {len(wanted)} free numbers in channel {name} ({', '.join(wanted)}), and the "
                f"table has {have} valid reading{'s' * (have != 1)} there: {len(wanted) - have} more are needed."
            )


def _reweighted(problem: FitProblem, end: Descent, share: float, notes: list[str]) -> tuple[Descent, FitProblem]:
    """Descents with σ from the model's own f, until its numbers settle [iteratively reweighted least squares]."""
    readings = problem.readings
    for _ in range(REWEIGHTINGS):
        f = problem.model_values(end.p)
        problem = problem.reweighted(residual_weights(readings, "sigma", relative_sigma(readings, f, share)))
        after = minimise(problem, [end.p], NEAR)[0]
        moved = np.max(np.abs(after.p - end.p) / np.maximum(np.abs(after.p), 1e-9))
        end = after
        if moved < SETTLED:
            return end, problem
    notes.append(f"the weights had not settled after {REWEIGHTINGS} rounds: the numbers still moved by {moved:.1g}")
    return end, problem
