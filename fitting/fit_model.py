"""One model fitted to readings: starts, descents, polish on all readings, and the statistics at the optimum."""

import dataclasses

import numpy as np

from gonio.data.layouts import Layout
from gonio.data.table import Channels
from gonio.fitting.options import FitSettings
from gonio.fitting.problem.compiled_sums import compile_sums
from gonio.fitting.problem.page_program import compile_page_program
from gonio.fitting.problem.parameterisation import Parameterisation, of_channel, parameters, snapped
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import BRIGHTER, Readings, loss_floor, relative_sigma, residual_weights
from gonio.fitting.programs_ahead import ahead, finished
from gonio.fitting.refinement import Refinement, noise_of
from gonio.fitting.solver.compiled_steps import compile_steps
from gonio.fitting.solver.curvature import completed
from gonio.fitting.solver.disc_choice import DiscAverages, choose_rules
from gonio.fitting.solver.fixed_bounds import with_bounds_fixed
from gonio.fitting.solver.levenberg_marquardt import NEAR, Descent, minimise
from gonio.fitting.solver.multistart import search
from gonio.fitting.uncertainty.optimum import Optimum, optimum_at
from gonio.models.compiled.program_memory import free_programs
from gonio.models.errors import GonioError
from gonio.models.expression.builder import build
from gonio.models.expression.parser import Term, numbers
from gonio.models.geometry.sides import Hemispheres, hemispheres_of, side_in_words


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
        counts: readings of the table by what became of them; `copies`: of those used, how many repeat others.
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
        sizes = s.sizes
        ahead(("step", sizes), lambda: compile_steps(sizes))
    ahead((s, loss), lambda: compile_sums(s, loss, fixed) or compile_page_program(s, loss, fixed))


def fit_model(task: FitTask) -> list[Optimum]:
    """The joint optimum of all channels, or one for each; GonioError where readings are too few for the model."""
    free_programs()
    channels = len(task.channels)
    for n in (n for t in task.terms for n in numbers(t)):
        if isinstance(n.value.number, tuple) and len(n.value.number) != channels:
            raise GonioError(
                f"'{task.requested}' gives {n.call.name}'s {n.name} {len(n.value.number)} values, but the table "
                f"has {channels} channel{'s' * (channels != 1)}; give one value each, or a single one."
            )
    if task.settings.per_channel and channels > 1:
        return [_optimum(task.channel(c)) for c in range(channels)]
    return [_optimum(task)]


def _optimum(task: FitTask) -> Optimum:
    s, fixed, given = parameters(task.terms, len(task.channels))
    _require_enough(task, s)
    _require_hemispheres(task, build(s.filled(task.terms, [given]), np.asarray).hemispheres)
    readings, settings = task.readings, task.settings
    share, likelihood = settings.relative_noise, task.likelihood
    sigma = task.sigma if share is None else relative_sigma(readings, readings.f, share)
    if s.size:
        finished()  # before anything large is laid out: compilers take a lot of memory for a moment
    floor = loss_floor(readings, task.loss)
    problem = FitProblem.create(s, fixed, task.loss, readings, residual_weights(readings, task.loss, sigma), floor)
    averaging = any(readings.half_angles) and settings.aperture == "average"
    known_noise = likelihood or share is not None
    if not s.size:
        return _without_free_numbers(problem, given, likelihood, averaging)
    starts = search(problem, given, settings.starts, settings.seed)
    if starts is None:
        raise GonioError(
            f"'{task.requested}' has no finite value at any start on these readings; hold a number with name=value, or "
            "begin elsewhere with name~value."
        )
    refinement = Refinement(share, settings.robust, known_noise, starts.cells, starts.ends)
    refined, averages = refinement.of(problem, starts.best), None
    if averaging:
        refined, averages = refinement.over_discs(problem, refined)
    elif any(readings.half_angles):
        averages = refinement.ignored(refined)
    end, problem, downweighted, notes = refined
    if not end.successful:
        end = completed(problem, end)
    agreement = (len(starts.ends), starts.agreed)

    def optimum(end: Descent) -> Optimum:
        p = s.with_ordered_lobes(fixed, snapped(problem.domains, end.p))
        stopped = [] if end.successful else ["the solver stopped at its step limit"]
        evaluation = problem.evaluate(p)
        return optimum_at(problem, p, evaluation, agreement, likelihood, [*notes, *stopped], downweighted)

    best = optimum(end)
    if end.successful and not best.converged:  # the last step was not evaluated before, and did not do
        best = optimum(minimise(problem, [best.p], NEAR)[0])
    if not best.converged and (refit := with_bounds_fixed(problem, best.p)) is not None:
        on_bounds = optimum(refit)
        best = on_bounds if on_bounds.converged else best
    return dataclasses.replace(best, averages=averages)


def _require_hemispheres(task: FitTask, scattered: Hemispheres) -> None:
    """GonioError where many readings are brighter than their noise, and the model is 0 there whatever its numbers."""
    readings, requested = task.readings, task.requested
    for light, detector in readings.sides:
        if hemispheres_of(frozenset({(light, detector)})) & scattered:
            continue
        if readings.brightness(light, detector) > BRIGHTER:
            number = sum(part.count for part in readings.on_sides(light, detector))
            raise GonioError(
                f"'{requested}' scatters nothing in {side_in_words(light, detector)}, where the table has "
                f"{number} readings above 0; add a term that does, such as "
                "lambert_transmission (gonio models), or give a table of the other readings alone"
            )


def _without_free_numbers(problem: FitProblem, p: np.ndarray, likelihood: bool, averaging: bool) -> Optimum:
    evaluation, averages = problem.evaluate(p), None
    if averaging:
        noise = 1.0 if likelihood else noise_of(problem, 0, float(evaluation.equations.cost))
        choice = choose_rules(problem, p, noise)
        averages = DiscAverages(True, problem.readings.half_angles, choice.rules, choice.neglected, p)
        problem = problem.averaged(choice.rules)
        evaluation = problem.evaluate(p)
    return dataclasses.replace(optimum_at(problem, p, evaluation, (1, 1), likelihood, [], None), averages=averages)


def _require_enough(task: FitTask, s: Parameterisation) -> None:
    for c, (name, have) in enumerate(zip(task.channels.names, task.readings.counts.tolist(), strict=True)):
        wanted = [n for n, channel in s.labels if channel in (c, None)]
        if have < len(wanted):
            raise GonioError(
                f"'{task.requested}' has {len(wanted)} free numbers in channel {name} ({', '.join(wanted)}), and the "
                f"table has {have} valid reading{'s' * (have != 1)} there: {len(wanted) - have} more are needed."
            )
