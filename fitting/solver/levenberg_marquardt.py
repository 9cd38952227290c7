"""Levenberg–Marquardt on streamed normal equations, several descents at once, made of Optimistix's own components.

Optimistix's `LevenbergMarquardt` wants the residual vector and its Jacobian; for a full table these are gigabytes. Here
its damped Newton descent and its trust region work on `FunctionInfo.EvalGradHessian`, which streaming supplies, with an
`Arrow` in place of the Hessian. A step is a program of its own that knows nothing of the model: it is compiled once for
all models of up to 8 free numbers, and for powers of two of channels. A descent ends as near to stationary as the
caller's precision allows, which need not be double.
"""

import dataclasses
import functools
import math
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gonio.fitting.problem.arrow import WHOLE, Arrow, Sizes
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains, Mapped, at_bounds, to_parameters, to_unconstrained
from gonio.fitting.problem.readings import LANES, AnyArray
from gonio.models.kept_jit import kept_jit

AIM = 1e-9  # the aim; a fit counts as stationary from 1e-6 on
NEARLY, LITTLE = 1e-7, 1e-13  # or this near, where the next step promises no more than this share of the cost
WORTHWHILE = 1e-3  # of what is left to gain, and of the cost: what a projection must promise
GROWTH = 2.0  # of the step's size where a projection is taken
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
    """The projected gradient at p, any leading axes; all in the order of the arrow."""
    low, high = at_bounds(d, p)
    active = (low & (equations.gradient >= 0)) | (high & (equations.gradient <= 0))
    length2 = np.asarray(equations.matrix.diagonal())
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
    hessian: Arrow
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
    import optimistix as optx

    class Damped(optx.DampedNewtonDescent):
        """Optimistix's descent, its system solved as an arrow."""

        def step(self, step_size: Float[AnyArray, ""], state: Any) -> tuple[Float[AnyArray, " p"], Any]:
            gradient = state.f_info.grad
            matrix = state.f_info.hessian.plus_diagonal(jnp.ones_like(gradient) / step_size)
            return -matrix.solved(gradient), optx.RESULTS.successful

    search = optx.ClassicalTrustRegion(high_cutoff=0.75, low_cutoff=1e-4, high_constant=4.0, low_constant=0.35)

    def info(normal: Normal, scale: Float[AnyArray, " p"]) -> Any:
        matrix = normal.hessian.scaled(1.0 / scale)
        # What no residual depends on has an empty row: a unit there keeps the matrix regular and the parameter still.
        matrix = matrix.plus_diagonal(jnp.where(matrix.diagonal() > 0, 0.0, 1.0))
        operator = cast(Any, matrix)  # of Lineax's operators only their product is used
        return optx.FunctionInfo.EvalGradHessian(jnp.asarray(normal.cost), normal.gradient / scale, operator)

    return Damped(), search, info, optx.FunctionInfo.Eval


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
    # A projected trial is no step of the quadratic model: it counts by its cost. Where that is lower the step's size
    # grows; else the step that it came from was too long, whatever the model promised of the projection.
    worthwhile = WORTHWHILE * jnp.maximum(jnp.minimum(before.cost, before.promised), 2.0 * rounding / WORTHWHILE)
    better = cost < before.cost - 0.5 * worthwhile
    accept = jnp.where(lane.projected, better, accept)
    # Along a valley that bends, steps grow by projections alone: what they come from is refused at any length.
    shorter = jnp.where(better, GROWTH, search.low_constant) * lane.step_size
    step_size = jnp.where(lane.projected, shorter, step_size)
    # Below its own rounding the cost says nothing, while the gradient still does: there a step counts by that.
    by_gradient = (cost <= before.cost + rounding) & (trial.stationarity < 0.9 * before.stationarity)
    by_gradient = by_gradient & ~accept & ~lane.first
    step_size = jnp.where(by_gradient, 10.0 * lane.step_size, step_size)
    accept = (accept | by_gradient) & finite
    project = ~accept & finite & ~lane.first & ~lane.projected
    project &= trial.cost - trial.gain < before.cost - worthwhile
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
    finite = jnp.isfinite(latest.cost) & jnp.all(jnp.isfinite(latest.gradient))
    finite &= functools.reduce(operator.and_, (jnp.all(jnp.isfinite(a)) for a in latest.hessian))
    cost = jnp.where(finite, latest.cost, jnp.inf)
    rounding = jnp.finfo(lane.y.dtype).eps * (
        4.0 * before.cost + jnp.sqrt(2.0 * jnp.maximum(before.cost, 0.0) * target_norm_squared)
    )
    accept, project, step_size = _decide(lane, latest, cost, finite, rounding)
    y, normal = jax.tree.map(lambda a, b: jnp.where(accept, a, b), (lane.trial, latest), (lane.y, before))
    lengths = jnp.sqrt(jnp.maximum(normal.hessian.diagonal(), 0.0))
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


@kept_jit
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
    size, shapes = lanes.y.shape[1], [a.shape for a in lanes.normal.hessian]
    lengths = [5, size, size, *(math.prod(shape[1:]) for shape in shapes)]
    numbers, gradient, projection, *hessian = jnp.split(packed, np.cumsum(lengths)[:-1], axis=1)
    cost, measure, exact, promised, gain = numbers.T
    hessian = Arrow(*(a.reshape(shape) for a, shape in zip(hessian, shapes, strict=True)))
    latest = Normal(cost, gradient, hessian, measure, exact > 0, promised, projection, gain)
    stepped = jax.vmap(_step, (0, 0, None, None))(lanes, latest, target_norm_squared, rough)
    lanes = jax.tree.map(lambda a, b: jnp.where(active.reshape(-1, *[1] * (a.ndim - 1)), a, b), stepped, lanes)
    flags = jnp.stack([lanes.accepted, lanes.finished, lanes.refused, lanes.near], axis=1).astype(lanes.trial.dtype)
    return lanes, jnp.concatenate([lanes.trial, flags], axis=1)


def packed_up(normal: Normal, sizes: Sizes) -> np.ndarray:
    """What was evaluated, in one array, padded to `LANES` descents of these sizes."""
    number, places = normal.cost.size, padded_places(normal.hessian.sizes, sizes)
    vectors, numbers = np.zeros((2, LANES, sizes.total)), np.zeros((LANES, 5))
    for k, a in enumerate((normal.cost, normal.stationarity, normal.exact, normal.promised, normal.gain)):
        numbers[:number, k] = a
    for padded, v in zip(vectors, (normal.gradient, normal.projection), strict=True):
        padded[:number, places] = v
    parts = []
    for part, shape in zip(normal.hessian, arrow_shapes(sizes), strict=True):
        padded = np.zeros((LANES, *shape))
        if part.size:  # without numbers of channels, the arrow has channels and the padded one none
            padded[(slice(number), *map(slice, part.shape[1:]))] = part
        parts.append(padded.reshape(LANES, -1))
    return np.concatenate([numbers, *vectors, *parts], axis=1)


def arrow_shapes(sizes: Sizes) -> list[tuple[int, ...]]:
    """Shapes of the parts of an arrow."""
    s, channels, q = sizes
    return [(s, s), (channels, s, q), (channels, q, q)]


@functools.lru_cache(maxsize=16)
def fresh(sizes: Sizes, step_size: float, double: bool) -> _Lane:
    """`LANES` descents before their first evaluation, in the precision of now (`double`: a key of the cache)."""
    zeros, no, none = np.zeros((LANES, sizes.total)), np.zeros(LANES, bool), np.zeros(LANES)
    hessian = Arrow(*(np.zeros((LANES, *shape)) for shape in arrow_shapes(sizes)))
    normal = Normal(none, zeros, hessian, none, no, none, zeros, none)
    lane = _Lane(~no, no, no, zeros, zeros, normal, zeros, none + 1.0, np.full(LANES, step_size), no, no, no)
    return jax.tree.map(jax.device_put, lane)


def padded_sizes(sizes: Sizes) -> Sizes:
    """The sizes that a step's program is compiled for; few numbers are treated as if channels shared them all."""

    def power(least: int, number: int) -> int:
        return max(least, 1 << (number - 1).bit_length())

    if sizes.total <= WHOLE or not sizes.per_channel:
        return Sizes(power(8, sizes.total), 0, 0)
    return Sizes(power(8, sizes.shared), power(8, sizes.channels), power(2, sizes.per_channel))


def padded_places(sizes: Sizes, padded: Sizes) -> np.ndarray:
    """Where the numbers of an arrow of these sizes stand in the padded one."""
    if not padded.channels:
        return np.arange(sizes.total)
    first = padded.shared + padded.per_channel * np.arange(sizes.channels)
    return np.concatenate([np.arange(sizes.shared), (first[:, None] + np.arange(sizes.per_channel)).ravel()])


def compile_step(sizes: Sizes) -> None:
    """Compile the program of a step for numbers of these sizes, before there is a model."""
    no = np.zeros(LANES, bool)
    lanes, length = fresh(sizes, 1.0, is_double()), 5 + 2 * sizes.total + sum(map(math.prod, arrow_shapes(sizes)))
    advance(lanes, np.zeros((LANES, length)), no, np.asarray(1.0), np.asarray(1.0))[1].block_until_ready()


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
    target_norm_squared, order, number = float(problem.target_norm_squared), problem.order, len(starts)
    d, linear = Domains(*(a[..., order] for a in problem.domains)), problem.linear[..., order]
    trial = to_unconstrained(d, starts[:, order])
    lanes: _Lane | None = None
    active, steps = np.arange(LANES) < number, np.zeros(number, int)
    finished = refused = settled = np.zeros(number, bool)
    points: _Points | None = None
    limits = np.asarray(target_norm_squared), np.asarray(float(stopping.rough))
    rounding = (30.0 * eps()) ** 2 * target_norm_squared
    for _ in range(stopping.most):
        parameters = to_parameters(d, trial, np)
        equations = problem.normal_equations(_unordered(parameters.p, order), active[:number])
        if equations.matrix.sizes.channels and not padded_sizes(equations.matrix.sizes).channels:
            equations = equations._replace(matrix=Arrow.dense(equations.matrix.whole()))
        now, normal = _evaluated(d, parameters, equations, rounding, linear)
        if lanes is None:
            sizes = padded_sizes(equations.matrix.sizes)
            places, start = padded_places(equations.matrix.sizes, sizes), np.zeros((LANES, sizes.total))
            start[:number, places] = trial
            lanes = fresh(sizes, UNDAMPED if stopping.near else DAMPED, is_double())._replace(trial=start, y=start)
        lanes, report = advance(lanes, packed_up(normal, sizes), active, *limits)
        report = np.asarray(report)[:number]
        trial, (accepted, finished, refused, settled) = report[:, places], report[:, sizes.total :].T > 0
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
    p = _unordered(np.where(settled[:, None], to_parameters(d, trial, np).p, points.p), order)
    cost = np.where(settled, points.cost - points.promised, points.cost)
    successful = finished & ~refused
    return [
        Descent(p[k], float(cost[k]), float(points.stationarity[k]), bool(points.exact[k]), int(steps[k]), bool(good))
        for k, good in enumerate(successful)
    ]


def _unordered(v: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Vectors in the parameters' own order, of vectors in that of the arrow."""
    plain = np.empty_like(v)
    plain[..., order] = v
    return plain


def _evaluated(
    d: Domains, mapped: Mapped, equations: NormalEquations, rounding: float, linear: np.ndarray
) -> tuple[_Points, Normal]:
    """What is known at some points, by the parameters and by the coordinates; `rounding`: of ‖r‖²."""
    with np.errstate(all="ignore"):  # what is not finite is a rejected step
        # The map's curvature is exact and free; negative curvature would spoil positive definiteness and is left out.
        bend = np.maximum(equations.gradient * mapped.curvature, 0.0)
        hessian = equations.matrix.scaled(mapped.slope).plus_diagonal(bend)
        measure = stationarity(d, mapped.p, equations).projected_gradient
        exact = 2.0 * equations.cost <= rounding
        gradient = equations.gradient * mapped.slope
        _, promised = _newton(hessian, gradient, np.ones_like(linear))
        projection, gain = _newton(hessian, gradient, linear)
        normal = Normal(equations.cost, gradient, hessian, measure, exact, promised, projection, gain)
    return _Points(mapped.p, equations.cost, measure, exact, promised), normal


def _newton(hessian: Arrow, gradient: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(undamped Newton steps (S, P) in the numbers that are `kept` (P,) alone, what they take off the cost (S,)).

    In the linear numbers alone [Golub & Pereyra 1973]: a trial in a curved valley is often refused for albedos and
    scales that do not fit its shapes.
    """
    slope, lengths = np.where(kept, gradient, 0.0), np.sqrt(hessian.diagonal())
    lengths = np.where(lengths > 0, lengths, 1.0)
    scaled = hessian.scaled(1.0 / lengths)
    scaled = scaled.plus_diagonal(np.where(scaled.diagonal() > 0, 1e-12, 1.0)).restricted(kept)
    move = -scaled.solved(slope / lengths) / lengths
    move = np.where(np.isfinite(move).all(axis=1, keepdims=True), move, 0.0)
    return move, -0.5 * np.sum(move * np.where(np.isfinite(slope), slope, 0.0), axis=-1)
