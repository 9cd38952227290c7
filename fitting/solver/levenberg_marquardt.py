"""Levenberg–Marquardt on streamed normal equations, several descents at once, made of Optimistix's own components.

Optimistix's `LevenbergMarquardt` wants the residual vector and its Jacobian; for a full table these are gigabytes. Here
its damped Newton descent and its trust region work on `FunctionInfo.EvalGradHessian`, which streaming supplies. A step
is a program of its own that knows nothing of the model: it is compiled once for all models of up to 8 free numbers.
A descent ends as near to stationary as the caller's precision allows, which need not be double.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from gonio.fitting.problem.parameterisation import Domains, Mapped, at_bounds, to_parameters, to_unconstrained
from gonio.fitting.problem.problem import NormalEquations
from gonio.fitting.problem.readings import LANES, AnyArray

AIM = 1e-9  # the aim; a fit counts as stationary from 1e-6 on
NEARLY, LITTLE = 1e-7, 1e-13  # or this near, where the next step promises no more than this share of the cost
WORTHWHILE = 1e-3  # of the cost: what a projection must promise
CLOSE = 1e-5  # or this near, where steps are seen to shrink so fast that the next one will do
IN_SINGLE = {"stationary": 3e-6, "nearly": 3e-5, "little": 1e-9, "close": 1e-3}  # the same in single precision
MAX_STEPS = 200
UNDAMPED, DAMPED = 1e8, 100.0  # the first step's size from near a minimum, and from afar as MINPACK's
HOPE = 4.0  # times as much as a Newton step promises: more will not come of a descent near a minimum

STATIONARY = 1e-6  # largest projected gradient of a stationary fit, in double precision
SINGLE = 16.0  # roundings of what is compared, from which on a gradient in single precision says nothing
EXACT = 1e3  # of the rounding of the data: residuals up to there are none


class Stationarity(NamedTuple):
    """How stationary p (..., P) is. Parameters on an active bound or without sensitivity do not count in the first.

    `projected_gradient`: max_j |J_jᵀr|/(‖J_j‖‖r‖); `active_bound` (..., P): on a bound that the cost pushes against;
    `zero_sensitivity` (..., P): without any effect on the residuals.
    """

    projected_gradient: np.ndarray
    active_bound: np.ndarray
    zero_sensitivity: np.ndarray


def stationarity(d: Domains, p: np.ndarray, equations: NormalEquations) -> Stationarity:
    """The projected gradient at p, any leading axes."""
    low, high = at_bounds(d, p)
    active = (low & (equations.gradient >= 0)) | (high & (equations.gradient <= 0))
    length2 = np.diagonal(equations.matrix, axis1=-2, axis2=-1)
    silent = length2 <= 0
    norm = np.sqrt(2.0 * np.maximum(np.asarray(equations.cost)[..., None], 1e-300))
    scale = np.sqrt(np.where(silent, 1.0, length2)) * norm
    share = np.where(active | silent, 0.0, np.abs(equations.gradient) / scale)
    return Stationarity(np.max(share, axis=-1, initial=0.0), active, silent)


def eps() -> float:
    """Relative spacing of the numbers that programs are compiled for."""
    return float(np.finfo(jnp.result_type(float)).eps)


def is_double() -> bool:
    """Whether programs are compiled for double precision."""
    return eps() < 1e-12


def stationary_limit(cost: float, target_norm_squared: float) -> float:
    """Largest projected gradient of a stationary fit of this cost, ½‖r‖².

    1e-6; in single precision no less than what the rounding of model and data makes of it, and no more than 1e-3.
    """
    if is_double():
        return STATIONARY
    compared = 1.0 + np.sqrt(target_norm_squared / max(2.0 * cost, 1e-300))
    return float(np.clip(SINGLE * eps() * compared, STATIONARY, 1e-3))


def is_exact(cost: float, target_norm_squared: float) -> bool:
    """‖r‖ ≤ 10³ eps ‖data‖: the residual is rounding."""
    return 2.0 * cost <= (EXACT * eps()) ** 2 * target_norm_squared


class Normal(NamedTuple):
    """Cost, gradient and Hessian in unconstrained coordinates, and how far from stationary; any leading axis."""

    cost: Float[AnyArray, ""]
    gradient: Float[AnyArray, " p"]
    hessian: Float[AnyArray, "p p"]
    stationarity: Float[AnyArray, ""]
    exact: Bool[AnyArray, ""]
    promised: Float[AnyArray, ""]  # what an undamped Newton step would take off the cost
    projection: Float[AnyArray, " p"]  # Newton step in the linear numbers alone
    gain: Float[AnyArray, ""]  # what that would take off


class _Lane(NamedTuple):
    """One descent between two evaluations: where it is, what it knows there, and where it wants to look next."""

    first: Bool[AnyArray, ""]
    projected: Bool[AnyArray, ""]  # whether the trial is a refused one whose linear numbers were solved for
    accepted: Bool[AnyArray, ""]
    y: Float[AnyArray, " p"]
    trial: Float[AnyArray, " p"]
    normal: Normal
    scale: Float[AnyArray, " p"]
    shrinks: Float[AnyArray, ""]  # what was left to gain after the last step, over what was before it
    step_size: Float[AnyArray, ""]
    near: Bool[AnyArray, ""]
    finished: Bool[AnyArray, ""]
    refused: Bool[AnyArray, ""]


@functools.cache
def _components() -> tuple[Any, Any, Callable, Any]:
    """Optimistix's descent and trust region, and how they take normal equations."""
    import lineax as lx
    import optimistix as optx

    class Damped(optx.DampedNewtonDescent):
        """Optimistix's descent, its small system solved in place: Lineax's machinery takes longer to trace than all
        else, and its Cholesky factors come from LAPACK, for which JAX imports SciPy first.
        """

        def step(self, step_size: Float[AnyArray, ""], state: Any) -> tuple[Float[AnyArray, " p"], Any]:
            matrix = state.f_info.hessian.as_matrix() + jnp.eye(state.f_info.grad.size) / step_size
            return -_eliminated(matrix, state.f_info.grad), optx.RESULTS.successful

    search = optx.ClassicalTrustRegion(high_cutoff=0.75, low_cutoff=1e-4, high_constant=4.0, low_constant=0.35)

    def info(normal: Normal, scale: Float[AnyArray, " p"]) -> Any:
        matrix = normal.hessian / (scale[:, None] * scale[None, :])
        # What no residual depends on has an empty row: a unit there keeps the matrix regular and the parameter still.
        matrix = matrix + jnp.diag(jnp.where(jnp.diagonal(matrix) > 0, 0.0, 1.0))
        operator = lx.MatrixLinearOperator(jnp.asarray(matrix), lx.positive_semidefinite_tag)
        return optx.FunctionInfo.EvalGradHessian(jnp.asarray(normal.cost), normal.gradient / scale, operator)

    return Damped(), search, info, optx.FunctionInfo.Eval


def _eliminated(matrix: Float[AnyArray, "p p"], vector: Float[AnyArray, " p"]) -> Float[AnyArray, " p"]:
    """Solution of a positive definite system by elimination without pivoting; NaN where it is not positive definite."""

    def eliminate(k: Array, rows: Array) -> Array:
        row = rows[k] / jnp.where(rows[k, k] > 0, rows[k, k], jnp.nan)
        return (rows - jnp.outer(rows[:, k], row)).at[k].set(row)

    rows = jnp.concatenate([matrix, vector[:, None]], axis=1)
    return jax.lax.fori_loop(0, vector.size, eliminate, rows)[:, -1]


def _aims(dtype: Any) -> dict[str, float]:
    if jnp.finfo(dtype).bits == 32:
        return IN_SINGLE
    return {"stationary": AIM, "nearly": NEARLY, "little": LITTLE, "close": CLOSE}


class _Decision(NamedTuple):
    """What is made of a trial: accepted, or to be projected, and the next step's size."""

    accept: Bool[AnyArray, ""]
    project: Bool[AnyArray, ""]
    step_size: Float[AnyArray, ""]


def _decide(
    lane: _Lane, trial: Normal, cost: Float[AnyArray, ""], finite: Bool[AnyArray, ""], rounding: Float[AnyArray, ""]
) -> _Decision:
    """By Optimistix's trust region; below the cost's own rounding by the gradient; or to be projected."""
    _, search, info, evaluated = _components()
    y, before = lane.y, lane.normal
    quadratic = info(before, jnp.ones_like(y))
    state = jax.tree.map(lambda _: lane.step_size, jax.eval_shape(search.init, y, quadratic))
    step_size, accept, _, _ = search.step(lane.first, y, lane.trial, quadratic, evaluated(cost), state)
    # A projected trial is no step of the quadratic model: it counts by its cost, and leaves the step's size as it is.
    better = cost < (1.0 - 0.5 * WORTHWHILE) * before.cost
    accept = jnp.where(lane.projected, better, accept)
    step_size = jnp.where(lane.projected & better, lane.step_size, step_size)
    # Below its own rounding the cost says nothing, while the gradient still does: there a step counts by that.
    by_gradient = (cost <= before.cost + rounding) & (trial.stationarity < 0.9 * before.stationarity)
    by_gradient = by_gradient & ~accept & ~lane.first
    step_size = jnp.where(by_gradient, 10.0 * lane.step_size, step_size)
    accept = (accept | by_gradient) & finite
    project = ~accept & finite & ~lane.first & ~lane.projected
    project &= trial.cost - trial.gain < (1.0 - WORTHWHILE) * before.cost
    return _Decision(accept, project, jnp.where(project, lane.step_size, step_size))


def _is_near(normal: Normal, shrinks: Float[AnyArray, ""], rough: Float[AnyArray, ""]) -> Bool[AnyArray, ""]:
    """Whether the next step will do: stationarity and what is left to gain shrink fast enough."""
    aim = _aims(shrinks.dtype)
    after = normal.stationarity * jnp.sqrt(shrinks)
    near = (normal.stationarity <= rough * aim["close"]) & (after <= rough * aim["nearly"])
    return near & (normal.promised * shrinks <= rough * aim["little"] * normal.cost)


def _step(lane: _Lane, latest: Normal, target_norm_squared: Float[AnyArray, ""], rough: Float[AnyArray, ""]) -> _Lane:
    """One damped Newton step, scaled as in MINPACK [Moré 1978], from what was evaluated at the trial point.

    A trial whose cost is not finite is a rejected step. Ends when stationary, exact, or when a step that could only
    change the cost by its rounding brings the gradient no further down; `rough`: relaxes what is stationary.
    """
    descent, _, info, _ = _components()
    before = lane.normal
    finite = jnp.isfinite(latest.cost) & jnp.all(jnp.isfinite(latest.gradient)) & jnp.all(jnp.isfinite(latest.hessian))
    cost = jnp.where(finite, latest.cost, jnp.inf)
    rounding = jnp.finfo(lane.y.dtype).eps * (
        4.0 * before.cost + jnp.sqrt(2.0 * jnp.maximum(before.cost, 0.0) * target_norm_squared)
    )
    accept, project, step_size = _decide(lane, latest, cost, finite, rounding)
    y, normal = jax.tree.map(lambda a, b: jnp.where(accept, a, b), (lane.trial, latest), (lane.y, before))
    lengths = jnp.sqrt(jnp.maximum(jnp.diagonal(normal.hessian), 0.0))
    scale = jnp.maximum(lane.scale, lengths)
    safe = jnp.where(scale > 0, scale, 1.0)
    now = info(normal, safe)
    move, _ = descent.step(step_size, descent.query(y, now, descent.init(y, now)))
    move = jnp.where(jnp.isfinite(move), move, 0.0)
    promised = -(jnp.dot(now.grad, move) + 0.5 * jnp.dot(move, now.hessian.mv(move)))
    spent = (promised <= rounding) & ~accept
    # Damping hides what is left to gain along a valley: nearness is judged without it.
    ratio = jnp.where(before.promised > 0, latest.promised / jnp.where(before.promised > 0, before.promised, 1.0), 1.0)
    shrinks = jnp.where(accept & ~lane.first, jnp.clip(ratio, 0.0, 1.0), jnp.where(accept, 1.0, lane.shrinks))
    near = _is_near(normal, shrinks, rough) & ~project
    refused = lane.first & ~finite
    stationary = normal.stationarity <= _aims(y.dtype)["stationary"]
    finished = stationary | near | normal.exact | (spent & ~project) | refused
    trial = jnp.where(project, lane.trial + latest.projection, y + move / safe)
    no = jnp.zeros_like(lane.first)
    return _Lane(no, project, accept, y, trial, normal, scale, shrinks, step_size, near, finished, refused)


@jax.jit
def advance(
    lanes: _Lane,
    packed: Float[AnyArray, "s q"],
    active: Bool[AnyArray, " s"],
    target_norm_squared: Float[AnyArray, ""],
    rough: Float[AnyArray, ""],
) -> tuple[_Lane, Float[AnyArray, "s r"]]:
    """(the lanes a step on; in one array their trial, accepted, finished, refused, near).

    What was evaluated comes in one array (see `packed_up`): each array by itself costs as long as a step.
    """
    size = lanes.y.shape[1]
    numbers, gradient, projection, hessian = jnp.split(packed, np.cumsum([5, size, size]), axis=1)
    cost, measure, exact, promised, gain = numbers.T
    hessian = hessian.reshape(-1, size, size)
    latest = Normal(cost, gradient, hessian, measure, exact > 0, promised, projection, gain)
    stepped = jax.vmap(_step, (0, 0, None, None))(lanes, latest, target_norm_squared, rough)
    lanes = jax.tree.map(lambda a, b: jnp.where(active.reshape(-1, *[1] * (a.ndim - 1)), a, b), stepped, lanes)
    flags = jnp.stack([lanes.accepted, lanes.finished, lanes.refused, lanes.near], axis=1).astype(lanes.trial.dtype)
    return lanes, jnp.concatenate([lanes.trial, flags], axis=1)


def packed_up(normal: Normal, size: int) -> np.ndarray:
    """What was evaluated, in one array, padded to `LANES` descents of `size` numbers."""
    number, free = normal.gradient.shape
    packed = np.zeros((LANES, 5 + size * (2 + size)))
    for k, a in enumerate((normal.cost, normal.stationarity, normal.exact, normal.promised, normal.gain)):
        packed[:number, k] = a
    packed[:number, 5 : 5 + free] = normal.gradient
    packed[:number, 5 + size : 5 + size + free] = normal.projection
    packed[:, 5 + 2 * size :].reshape(LANES, size, size)[:number, :free, :free] = normal.hessian
    return packed


@functools.lru_cache(maxsize=16)
def fresh(size: int, step_size: float, double: bool) -> _Lane:
    """`LANES` descents before their first evaluation, in the precision of now (`double`: a key of the cache)."""
    zeros, no, none = np.zeros((LANES, size)), np.zeros(LANES, bool), np.zeros(LANES)
    normal = Normal(none, zeros, np.zeros((LANES, size, size)), none, no, none, zeros, none)
    lane = _Lane(~no, no, no, zeros, zeros, normal, zeros, none + 1.0, np.full(LANES, step_size), no, no, no)
    return jax.tree.map(jax.device_put, lane)


def padded_size(free: int) -> int:
    """The numbers that a step's program is compiled for, of which so many are free."""
    return max(8, 1 << (free - 1).bit_length())


def compile_step(free: int) -> None:
    """Compile the program of a step for so many free numbers, before there is a model."""
    size, no = padded_size(free), np.zeros(LANES, bool)
    lanes, none = fresh(size, 1.0, is_double()), np.zeros((LANES, 5 + size * (2 + size)))
    advance(lanes, none, no, np.asarray(1.0), np.asarray(1.0))[1].block_until_ready()


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
    number, free = starts.shape
    size = padded_size(free)
    lanes, start = fresh(size, UNDAMPED if stopping.near else DAMPED, is_double()), np.zeros((LANES, size))
    start[:number, :free] = trial = to_unconstrained(d, starts)
    lanes = lanes._replace(trial=start, y=start)
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
    successful = finished & ~refused
    return [
        Descent(p[k], float(cost[k]), float(points.stationarity[k]), bool(points.exact[k]), int(steps[k]), bool(good))
        for k, good in enumerate(successful)
    ]


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
