"""Levenberg–Marquardt on streamed normal equations, several descents at once, made of Optimistix's own components.

Optimistix's `LevenbergMarquardt` wants the residual vector and its Jacobian; for a full table these are gigabytes. Here
its damped Newton descent and its trust region work on `FunctionInfo.EvalGradHessian`, which streaming supplies.
"""

import contextlib
import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from gonio.fitting.problem.domains import Domains, Mapped, to_parameters, to_unconstrained
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.readings import LANES
from gonio.fitting.solver.convergence import eps, is_double, stationarity
from gonio.fitting.solver.lm_step import Normal, advance, fresh, packed_up, padded_size

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
        """Which parameters (P,) the model is proportional to."""
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
    """The end of one descent: parameters (P,), the normal equations there or one step before, how stationary.

    Where the last step was not evaluated any more, the cost is what it promised.
    """

    p: np.ndarray
    equations: NormalEquations
    stationarity: float
    exact: bool
    steps: int
    successful: bool  # by the solver's own word

    @property
    def cost(self) -> float:
        """½ Σ r²."""
        return float(self.equations.cost)


class Stopping(NamedTuple):
    """When descents end.

    `near`: the starts are near minima, and need no damping at first. `rough`: factor by which the limits of
    stationarity are relaxed. `rivals`: only the lowest end matters; a descent that will not reach it may stop where it
    is. `enough`: decrease of the cost, promised by a Newton step, below which a descent may stop. `most`: steps.
    """

    near: bool = False
    rough: float = 1.0
    rivals: bool = False
    enough: float = 0.0
    most: int = MAX_STEPS


AFAR, NEAR = Stopping(), Stopping(near=True)


class _Points(NamedTuple):
    """What is known at the points of S descents."""

    p: np.ndarray
    cost: np.ndarray
    gradient: np.ndarray
    matrix: np.ndarray
    stationarity: np.ndarray
    exact: np.ndarray
    promised: np.ndarray  # what an undamped Newton step takes off the cost


def minimise(
    problem: LeastSquares, starts: Sequence[np.ndarray] | np.ndarray, stopping: Stopping = AFAR
) -> list[Descent]:
    """The ends of descents from parameters (P,), `LANES` of them side by side.

    Args:
        problem: what is minimised.
        starts: parameters of each start; at most `LANES` where each has domains of its own.
        stopping: when a descent ends.
    """
    blocks = (starts[first : first + LANES] for first in range(0, len(starts), LANES))
    return [end for block in blocks for end in _descend(problem, np.stack(list(block)), stopping)]


def _descend(problem: LeastSquares, starts: np.ndarray, stopping: Stopping) -> list[Descent]:
    d, target_norm_squared, linear = problem.domains, float(problem.target_norm_squared), problem.linear
    steps_in = np.stack([np.ones_like(linear), linear])
    trial = to_unconstrained(d, starts)
    number, free = trial.shape
    size = padded_size(free)
    start = np.zeros((LANES, size))
    start[:number, :free] = trial
    lanes = fresh(size, UNDAMPED if stopping.near else DAMPED, is_double())._replace(trial=start, y=start)
    active, steps = np.arange(LANES) < number, np.zeros(number, int)
    finished = refused = settled = np.zeros(number, bool)
    points: _Points | None = None
    limits = np.asarray(target_norm_squared), np.asarray(float(stopping.rough))
    rounding = (30.0 * eps()) ** 2 * target_norm_squared
    for _ in range(stopping.most):
        parameters = to_parameters(d, trial, np)
        equations = problem.normal_equations(parameters.p, active[:number])
        now, normal = _evaluated(d, parameters, equations, rounding, steps_in)
        lanes, report = advance(lanes, packed_up(normal, size), active, *limits)
        report = np.asarray(report)[:number]
        trial, (accepted, finished, refused, settled) = report[:, :free], report[:, size:].T > 0
        taken = accepted & active[:number]
        points = now if points is None else _Points(
            *(np.where(taken.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(now, points, strict=True))
        )  # fmt: skip
        steps += active[:number]
        active[:number] &= ~(finished | (taken & (now.promised < stopping.enough)))
        if stopping.rivals:
            active[:number] &= ~(points.cost - HOPE * points.promised > np.min(points.cost))
        if not active.any():
            break
    assert points is not None
    # So near, the last step is as good as taken.
    settled = (settled | (points.promised < stopping.enough)) & ~points.exact
    p = np.where(settled[:, None], to_parameters(d, trial, np).p, points.p)
    cost = np.where(settled, points.cost - points.promised, points.cost)
    return [
        Descent(
            p[k], NormalEquations(cost[k], points.gradient[k], points.matrix[k]), float(points.stationarity[k]),
            bool(points.exact[k]), int(steps[k]), bool(finished[k] and not refused[k]),
        )
        for k in range(number)
    ]  # fmt: skip


def _evaluated(
    d: Domains, mapped: Mapped, equations: NormalEquations, rounding: float, steps_in: np.ndarray
) -> tuple[_Points, Normal]:
    """What is known at some points, by the parameters and by the coordinates; `rounding`: of ‖r‖²."""
    with np.errstate(all="ignore"):  # what is not finite is a rejected step
        # The map's curvature is exact and free; negative curvature would spoil positive definiteness and is left out.
        bend = np.maximum(equations.gradient * mapped.curvature, 0.0)
        hessian = equations.matrix * mapped.slope[:, :, None] * mapped.slope[:, None, :]
        diagonal = np.arange(bend.shape[1])
        hessian[:, diagonal, diagonal] += bend
        measure = stationarity(d, mapped.p, equations).projected_gradient
        exact = 2.0 * equations.cost <= rounding
        gradient = equations.gradient * mapped.slope
        (_, projection), (promised, gain) = _newton(hessian, gradient, steps_in)
        normal = Normal(equations.cost, gradient, hessian, measure, exact, promised, projection, gain)
    return _Points(mapped.p, *equations, measure, exact, promised), normal


def _newton(hessian: np.ndarray, gradient: np.ndarray, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(undamped Newton steps (M, S, P), each in the numbers `of` (M, P) alone, what they take off the cost (M, S)).

    In the linear numbers alone [Golub & Pereyra 1973]: a trial in a curved valley is often refused for albedos and
    scales that do not fit its shapes.
    """
    good = np.asarray(np.isfinite(hessian).all((1, 2)) & np.isfinite(gradient).all(1))
    slope = np.where(good[:, None], gradient, 0.0)
    lengths = np.sqrt(np.diagonal(hessian, axis1=1, axis2=2))
    lengths = np.where(good[:, None] & (lengths > 0), lengths, 1.0)
    scaled = np.where(good[:, None, None], hessian / (lengths[:, :, None] * lengths[:, None, :]), 0.0)
    unit = np.eye(of.shape[1])
    scaled = scaled + np.where(np.diagonal(scaled, axis1=1, axis2=2) > 0, 1e-12, 1.0)[:, :, None] * unit
    # What does not step has an equation of its own that says so.
    scaled = np.where((of[:, :, None] & of[:, None, :])[:, None], scaled, unit)
    move = np.zeros((*of.shape[:1], *gradient.shape))
    with contextlib.suppress(np.linalg.LinAlgError):
        move = -np.linalg.solve(scaled, np.where(of[:, None], slope / lengths, 0.0)[..., None])[..., 0] / lengths
    move = np.where(np.isfinite(move), move, 0.0)
    return move, -0.5 * np.sum(move * slope, axis=-1)
