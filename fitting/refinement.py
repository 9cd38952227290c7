"""What follows the search of a fit: relative and robust weights, and averages over the discs of the apertures."""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import relative_sigma, residual_weights
from gonio.fitting.solver.disc_choice import DiscAverages, choose_rules, notices_discs, step_towards, uniform_rules
from gonio.fitting.solver.levenberg_marquardt import NEAR, Descent, minimise
from gonio.fitting.solver.robust_weights import ROUNDS, DownweightedReadings, robust_fit

REWEIGHTINGS = 30
SETTLED = 1e-8  # relative change of the numbers from which on relative weights have settled
CHOICES = 4  # of how finely to average, each on the numbers that the one before led to
STEADY = 0.02  # relative change of numbers up to which the choice stands
QUIETER = 0.15  # relative fall of the noise up to which it stands: that of few readings is not known better


class Refined(NamedTuple):
    """The end of a fit, its problem with the last weights, what counts less in it, and sentences about it."""

    descent: Descent
    problem: FitProblem
    downweighted: DownweightedReadings | None
    notes: list[str]


@dataclasses.dataclass(frozen=True)
class Refinement:
    """How the best descent of a search goes on.

    Attributes:
        relative_noise: standard uncertainty as a share of the model's own f, or None.
        robust: kind of robust weights, or None.
        known_noise: whether weighted residuals have a standard deviation of 1.
        cells, ends: some cells, and where descents on them ended.
    """

    relative_noise: float | None
    robust: str | None
    known_noise: bool
    cells: np.ndarray
    ends: list[Descent]

    def of(self, problem: FitProblem, end: Descent) -> Refined:
        """The fit with relative and robust weights, from where that without them ended."""
        notes, downweighted = [], None
        if self.relative_noise is not None:
            end, problem = _reweighted(problem, end, self.relative_noise, notes)
        if self.robust is not None:
            robust = robust_fit(problem, self.robust, self.cells, [end, *self.ends])
            end, problem, downweighted = robust.descent, robust.problem, robust.downweighted
            if not robust.settled:
                notes.append(f"the robust weights had not settled after {ROUNDS} rounds")
        return Refined(end, problem, downweighted, notes)

    def over_discs(self, points: FitProblem, at_centres: Refined) -> tuple[Refined, DiscAverages]:
        """The fit of averages over the discs of each reading, from where that at their centres ended.

        Args:
            points: the problem at the centres, without relative and robust weights.
            at_centres: where it ended.
        """
        refined, rules = at_centres, np.zeros(points.weight.shape[0], int)
        noise = self._noise(refined.problem, refined.descent)
        # What some of the readings notice, all do: their numbers are known better.
        parts = (refined.problem.subset(self.cells), refined.problem)
        if not any(notices_discs(part, refined.descent.p, noise) for part in parts):
            return refined, DiscAverages(
                True, points.readings.half_angles, rules, 0.0, np.zeros(refined.descent.p.size)
            )
        near, noise = self._near(at_centres, noise)
        for _ in range(CHOICES):
            before, louder, choice = near, noise, choose_rules(refined.problem, near, noise)
            if np.array_equal(choice.rules, rules):
                break
            rules, problem = choice.rules, points.averaged(choice.rules)
            refined = self.of(problem, minimise(problem, [before], NEAR)[0])
            near, noise = refined.descent.p, self._noise(refined.problem, refined.descent)
            if _settled(before, near, louder, noise):
                break
        shift = at_centres.descent.p - refined.descent.p
        neglected = choice.neglected * louder / noise
        return refined, DiscAverages(True, points.readings.half_angles, rules, neglected, shift)

    def _near(self, at_centres: Refined, noise: float) -> tuple[np.ndarray, float]:
        """Numbers and noise near those of averages, from few of the cells: the choice for all need not be repeated."""
        p = at_centres.descent.p
        if self.cells.size == at_centres.problem.weight.shape[0]:
            return p, noise
        few = at_centres.problem.subset(self.cells)
        # By one rule for all first: what it leaves out matters less than what the centres do.
        uniform = few.averaged(uniform_rules(few))
        end = minimise(uniform, [p], NEAR)[0]
        p, noise = end.p, self._noise(uniform, end)
        for _ in range(CHOICES):
            before, louder = p, noise
            averaged = few.averaged(choose_rules(few, p, noise).rules)
            end = minimise(averaged, [p], NEAR)[0]
            p, noise = end.p, self._noise(averaged, end)
            # Of known noise that little is beyond is no more to be told, however much the numbers before it left.
            quiet = self.known_noise and noise - 1.0 < QUIETER
            if _settled(before, p, noise if quiet else louder, noise):
                break
        return p, noise

    def ignored(self, at_centres: Refined) -> DiscAverages:
        """What the numbers at the centres are off by, to first order: a step towards the fit of averages."""
        problem, p = at_centres.problem, at_centres.descent.p
        choice = choose_rules(problem, p, self._noise(problem, at_centres.descent))
        shift = -step_towards(problem.averaged(choice.rules), p)
        return DiscAverages(False, problem.readings.half_angles, choice.rules, choice.neglected, shift)

    def _noise(self, problem: FitProblem, end: Descent) -> float:
        # Where the model leaves more than the noise, its numbers are not known to the noise either.
        remaining = noise_of(problem, end.p.size, end.cost)
        return max(remaining, 1.0) if self.known_noise else remaining


def _settled(before: np.ndarray, after: np.ndarray, louder: float, noise: float) -> bool:
    """Whether a choice made with these numbers and noise stands for those that it led to: more noise notices less."""
    return _moved(before, after) < STEADY and louder / noise - 1.0 < QUIETER


def _moved(before: np.ndarray, after: np.ndarray) -> float:
    """Largest relative change of the numbers."""
    return float(np.max(np.abs(after - before) / np.maximum(np.abs(after), 1e-9)))


def noise_of(problem: FitProblem, numbers: int, cost: float) -> float:
    """Standard deviation of the weighted residuals of a fit of so many free numbers that ended at this cost."""
    return max(float(np.sqrt(2.0 * cost / max(problem.readings.count - numbers, 1))), 1e-300)


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
