"""A step of Levenberg and Marquardt's, made of Optimistix's own components, of several descents at once.

A step is a program of its own that knows nothing of the model: it is compiled once for all models of up to 8 free
numbers. Whatever a first fit would wait for is loaded when it is first needed, so that it may be got ready beforehand.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from gonio.fitting.problem.readings import LANES, AnyArray
from gonio.fitting.solver.convergence import is_double

STATIONARY = 1e-9  # the aim; a fit counts as stationary from 1e-6 on
NEARLY, LITTLE = 1e-7, 1e-13  # or this near, where the next step promises no more than this share of the cost
WORTHWHILE = 1e-3  # of the cost: what a projection must promise
CLOSE = 1e-5  # or this near, where steps are seen to shrink so fast that the next one will do
IN_SINGLE = {"stationary": 3e-6, "nearly": 3e-5, "little": 1e-9, "close": 1e-3}  # the same in single precision


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
    return {"stationary": STATIONARY, "nearly": NEARLY, "little": LITTLE, "close": CLOSE}


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
