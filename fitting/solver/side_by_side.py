"""Descents of several small problems of unlike sizes, side by side: a step costs the same for one as for all."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from gonio.fitting.problem.arrow import WHOLE, Arrow, Sizes
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import LINEAR, Domains
from gonio.fitting.problem.readings import LANES
from gonio.fitting.solver.levenberg_marquardt import Descent, LeastSquares, Stopping, minimise
from gonio.fitting.solver.xla_steps import padded_sizes


class TogetherSums(Protocol):
    """The normal equations of several problems at once."""

    def equations(self, p: np.ndarray, active: np.ndarray) -> NormalEquations | None:
        """At numbers (S, size) of each problem, in the order of its normal equations, of the active ones (S,); None
        where each has to be asked for its own."""
        ...


@dataclasses.dataclass(frozen=True)
class _Together:
    """One problem of each lane as a problem of `LeastSquares`, whose last numbers may act on nothing.

    A lane's numbers are in the order of its problem's normal equations.
    """

    problems: tuple[LeastSquares, ...]
    size: int
    domains: Domains
    """Closed domains (S, P); those of numbers that act on nothing are any."""
    linear: np.ndarray
    """Which numbers (S, P) a lane's model is proportional to."""
    sums: TogetherSums | None

    @classmethod
    def of(cls, problems: Sequence[LeastSquares], size: int, sums: TogetherSums | None) -> "_Together":
        """Problems of at most so many numbers."""
        shape = len(problems), size
        domains = Domains(np.full(shape, LINEAR), np.zeros(shape), np.ones(shape))
        linear = np.zeros(shape, bool)
        for k, problem in enumerate(problems):
            for whole, part in zip((*domains, linear), (*problem.domains, problem.linear), strict=True):
                whole[k, : problem.order.size] = part[problem.order]
        return cls(tuple(problems), size, domains, linear, sums)

    @property
    def order(self) -> np.ndarray:
        """That of the lanes' numbers (P,)."""
        return np.arange(self.size)

    @property
    def target_norm_squared(self) -> float:
        """‖data‖², the same of all."""
        return self.problems[0].target_norm_squared

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None) -> NormalEquations:
        """At vectors p (S, P), of the active lanes (S,)."""
        active = np.broadcast_to(True if active is None else active, (len(p),))
        equations = None if self.sums is None else self.sums.equations(p, active)
        if equations is not None:
            return equations
        lanes = np.flatnonzero(active)
        cost, gradient = np.zeros(len(p)), np.zeros(p.shape)
        matrix = np.zeros((*p.shape, self.size))
        # Lanes of one problem stand side by side.
        edges = [k for k in range(1, lanes.size) if self.problems[lanes[k]] is not self.problems[lanes[k - 1]]]
        for these in np.split(lanes, edges):
            if not these.size:
                continue
            problem = self.problems[these[0]]
            number = problem.order.size
            numbers = np.empty((these.size, number))
            numbers[:, problem.order] = p[these, :number]
            equations = problem.normal_equations(numbers)
            cost[these], gradient[these, :number] = equations.cost, equations.gradient
            matrix[these, :number, :number] = equations.matrix.whole()
        return NormalEquations(cost, gradient, Arrow.dense(matrix))


def minimise_all(
    problems: Sequence[Any],
    starts: Sequence[Sequence[np.ndarray]],
    stopping: Stopping,
    sums_of: Callable[[Sequence[Any], int], TogetherSums | None] = lambda *_: None,
) -> list[list[Descent]]:
    """The ends of descents of several problems of the same data, each from starts of its own.

    Args:
        problems: what is minimised, each of `LeastSquares`; those of more than `WHOLE` numbers go one after another.
        starts: of each problem, its vectors (P,).
        stopping: when a descent ends; rivals are not known here.
        sums_of: of several problems, of at most so many numbers each, what sums them together, if anything does.

    Returns:
        Of each problem, the ends from its starts.
    """
    ends: list[list[Descent | None]] = [[None] * len(of_problem) for of_problem in starts]
    lanes: dict[int, list[tuple[int, int]]] = {}
    for k, problem in enumerate(problems):
        number = problem.order.size
        if number > WHOLE:
            ends[k] = list(minimise(problem, starts[k], stopping))
        else:
            size = padded_sizes(Sizes(number, 0, 0)).total
            lanes.setdefault(size, []).extend((k, j) for j in range(len(starts[k])))
    for size, every in lanes.items():
        for block in (every[first : first + LANES] for first in range(0, len(every), LANES)):
            of_block = [problems[k] for k, _ in block]
            together = _Together.of(of_block, size, sums_of(of_block, size))
            padded = np.full((len(block), size), 0.5)
            for row, (k, j) in zip(padded, block, strict=True):
                row[: problems[k].order.size] = starts[k][j][problems[k].order]
            for (k, j), end in zip(block, minimise(together, padded, stopping), strict=True):
                numbers = np.empty(problems[k].order.size)
                numbers[problems[k].order] = end.p[: numbers.size]
                ends[k][j] = dataclasses.replace(end, p=numbers)
    return [[end for end in of_problem if end is not None] for of_problem in ends]
