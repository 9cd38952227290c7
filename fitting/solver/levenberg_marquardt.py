"""Levenberg–Marquardt on streamed normal equations, several descents at once, made of Optimistix's own components.

A step knows nothing of the model (see `lm_step`). A descent ends as near to stationary as the caller's precision
allows, which need not be double.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains, to_parameters, to_unconstrained
from gonio.fitting.problem.readings import LANES
from gonio.fitting.solver.compiled_steps import steps_of
from gonio.fitting.solver.xla_steps import Descents, Points

MAX_STEPS = 200
UNDAMPED, DAMPED = 1e8, 100.0  # the first step's size from near a minimum, and from afar as MINPACK's
HOPE = 4.0  # times as much as a Newton step promises: more will not come of a descent near a minimum


class LeastSquares(Protocol):
    """A least-squares problem of P bounded parameters, as the solver takes it."""

    @property
    def domains(self) -> Domains:
        """Closed domains, of shape (P,), or (S, P) for S descents."""
        ...

    @property
    def linear(self) -> np.ndarray:
        """Which parameters, of shape (P,), or (S, P) for S descents, the model is proportional to."""
        ...

    @property
    def order(self) -> np.ndarray:
        """Index, among the parameters, of each number of the normal equations (P,)."""
        ...

    @property
    def target_norm_squared(self) -> float:
        """‖data‖²."""
        ...

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None) -> NormalEquations:
        """At up to `LANES` vectors p (S, P), of the active ones (S,)."""
        ...


@dataclasses.dataclass(frozen=True)
class Descent:
    """The end of one descent: parameters (P,), ½ Σ r², how stationary.

    Where the last step was not evaluated any more, the cost is what it promised.
    """

    p: np.ndarray
    cost: float
    stationarity: float
    exact: bool
    steps: int
    successful: bool  # by the solver's own word


class Stopping(NamedTuple):
    """When descents end.

    `near`: the starts are near minima, and need no damping at first. `rough`: factor by which the limits of
    stationarity are relaxed. `rivals`: only the lowest end matters; a descent that will not reach it may stop where it
    is. `enough`: decrease of the cost, promised by a Newton step, below which a descent may stop. `most`: steps.
    `below`, `above`: costs, of all or of each start, that say enough: one that has been reached, and one that will not.
    """

    near: bool = False
    rough: float = 1.0
    rivals: bool = False
    enough: float = 0.0
    most: int = MAX_STEPS
    below: float | np.ndarray = -np.inf
    above: float | np.ndarray = np.inf


AFAR, NEAR = Stopping(), Stopping(near=True)


def minimise(
    problem: LeastSquares, starts: Sequence[np.ndarray] | np.ndarray, stopping: Stopping = AFAR
) -> list[Descent]:
    """The ends of descents from parameters (P,), `LANES` of them side by side.

    Args:
        problem: what is minimised.
        starts: parameters of each start; at most `LANES` where each has domains or limits of its own.
        stopping: when a descent ends.
    """
    blocks = (starts[first : first + LANES] for first in range(0, len(starts), LANES))
    return [end for block in blocks for end in _descend(problem, np.stack(list(block)), stopping)]


def _descend(problem: LeastSquares, starts: np.ndarray, stopping: Stopping) -> list[Descent]:
    target_norm_squared, order, number = float(problem.target_norm_squared), problem.order, len(starts)
    d, linear = Domains(*(a[..., order] for a in problem.domains)), problem.linear[..., order]
    start, step_size = to_unconstrained(d, starts[:, order]), UNDAMPED if stopping.near else DAMPED
    descents = Descents(d, linear, start, step_size, target_norm_squared, stopping.rough)
    p, count = to_parameters(d, start, np).p, np.zeros(number, int)
    active, steps, report = np.ones(number, bool), None, None
    points: Points | None = None
    for _ in range(stopping.most):
        equations = problem.normal_equations(_unordered(p, order), active)
        steps = steps or steps_of(descents, equations.matrix.sizes)
        report = steps(equations, active)
        p, now, taken = report.p, report.points, report.accepted & active
        points = points or Points(*map(np.array, now))
        for kept, latest in zip(points, now, strict=True):
            np.copyto(kept, latest, where=taken if latest.ndim == 1 else taken[:, None])
        count += active
        active = active & ~(report.finished | (taken & (now.promised < stopping.enough)))
        if stopping.rivals:
            active &= ~(points.cost - HOPE * points.promised > np.min(points.cost))
        active &= ~((points.cost <= stopping.below) | (points.cost - HOPE * points.promised > stopping.above))
        if not active.any():
            break
    assert points is not None and report is not None
    # So near, the last step is as good as taken.
    settled = (report.near | (points.promised < stopping.enough)) & ~points.exact
    p = _unordered(np.where(settled[:, None], p, points.p), order)
    cost = np.where(settled, points.cost - points.promised, points.cost)
    successful = report.finished & ~report.refused
    return [
        Descent(p[k], float(cost[k]), float(points.stationarity[k]), bool(points.exact[k]), int(count[k]), bool(good))
        for k, good in enumerate(successful)
    ]


def _unordered(v: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Vectors in the parameters' own order, of vectors in that of the arrow."""
    plain = np.empty_like(v)
    plain[..., order] = v
    return plain
