"""A step of Levenberg and Marquardt's, made of Optimistix's own parts, of several descents at once.

A step is a program of its own that knows nothing of the model: it is compiled once for all models of up to 8 free
numbers. Whatever a first fit would wait for is loaded when it is first needed, so that it may be got ready beforehand.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from gonio.fitting.problem.blocks import LANES
from gonio.fitting.solver.convergence import is_double

STATIONARY = 1e-9  # the aim; DESIGN's test asks for 1e-6
NEARLY, LITTLE = 1e-7, 1e-13  # or this near, where the next step promises no more than this share of the cost
WORTH = 1e-3  # of the cost: what a projection must promise
CLOSE = 1e-5  # or this near, where steps are seen to shrink so fast that the next one will do
IN_SINGLE = {"stationary": 3e-6, "nearly": 3e-5, "little": 1e-9, "close": 1e-3}  # the same in single precision


class Normal(NamedTuple):
    """Cost, gradient and Hessian in unconstrained coordinates, and how far from stationary; any leading axis."""

    cost: Float[Array, ""]
    gradient: Float[Array, " p"]
    hessian: Float[Array, "p p"]
    stationarity: Float[Array, ""]
    exact: Bool[Array, ""]
    left: Float[Array, ""]  # what an undamped Newton step would take off the cost
    projection: Float[Array, " p"]  # Newton step in the linear numbers alone
    gain: Float[Array, ""]  # what that would take off


class _Lane(NamedTuple):
    """One descent between two evaluations: where it is, what it knows there, and where it wants to look next."""

    first: Bool[Array, ""]
    projected: Bool[Array, ""]  # whether the trial is a refused one whose linear numbers were solved for
    accepted: Bool[Array, ""]
    y: Float[Array, " p"]
    trial: Float[Array, " p"]
    normal: Normal
    scale: Float[Array, " p"]
    shrinks: Float[Array, ""]  # what was left to gain after the last step, over what was before it
    step_size: Float[Array, ""]
    near: Bool[Array, ""]
    finished: Bool[Array, ""]
    refused: Bool[Array, ""]


@functools.cache
def _parts():
    """Optimistix's descent and trust region, and how they are told of normal equations."""
    import lineax as lx
    import optimistix as optx

    class Damped(optx.DampedNewtonDescent):
        """Optimistix's descent, its small system solved in place: Lineax's machinery takes longer to trace than all
        else, and its Cholesky factors come from LAPACK, for which JAX imports SciPy first.
        """

        def step(self, step_size, state):
            matrix = state.f_info.hessian.as_matrix() + jnp.eye(state.f_info.grad.size) / step_size
            return -_eliminated(matrix, state.f_info.grad), optx.RESULTS.successful

    search = optx.ClassicalTrustRegion(high_cutoff=0.75, low_cutoff=1e-4, high_constant=4.0, low_constant=0.35)

    def info(normal: Normal, scale):
        matrix = normal.hessian / (scale[:, None] * scale[None, :])
        # What no residual depends on has an empty row: a unit there keeps the matrix regular and the parameter still.
        matrix = matrix + jnp.diag(jnp.where(jnp.diagonal(matrix) > 0, 0.0, 1.0))
        operator = lx.MatrixLinearOperator(matrix, lx.positive_semidefinite_tag)
        return optx.FunctionInfo.EvalGradHessian(normal.cost, normal.gradient / scale, operator)

    return Damped(), search, info, optx.FunctionInfo.Eval


def _eliminated(matrix, vector):
    """Solution of a positive definite system by elimination without pivoting; NaN where it is not positive definite."""

    def eliminate(k, rows):
        row = rows[k] / jnp.where(rows[k, k] > 0, rows[k, k], jnp.nan)
        return (rows - jnp.outer(rows[:, k], row)).at[k].set(row)

    rows = jnp.concatenate([matrix, vector[:, None]], axis=1)
    return jax.lax.fori_loop(0, vector.size, eliminate, rows)[:, -1]


def _aims(dtype) -> dict[str, float]:
    if jnp.finfo(dtype).bits == 32:
        return IN_SINGLE
    return {"stationary": STATIONARY, "nearly": NEARLY, "little": LITTLE, "close": CLOSE}


def _step(lane: _Lane, seen: Normal, target_norm_squared, rough) -> _Lane:
    """One damped Newton step, scaled as in MINPACK [Moré 1978], after the trial point has been `seen`.

    A trial whose cost is not finite is a rejected step. Ends when stationary, exact, or when a step that could only
    change the cost by its rounding brings the gradient no further down; `rough`: relaxes what is stationary.
    """
    descent, search, info, evaluated = _parts()
    y, before = lane.y, lane.normal
    finite = jnp.isfinite(seen.cost) & jnp.all(jnp.isfinite(seen.gradient)) & jnp.all(jnp.isfinite(seen.hessian))
    cost = jnp.where(finite, seen.cost, jnp.inf)
    at = info(before, jnp.ones_like(y))
    state = jax.tree.map(lambda _: lane.step_size, jax.eval_shape(search.init, y, at))
    step_size, accept, _, _ = search.step(lane.first, y, lane.trial, at, evaluated(cost), state)
    # A projected trial is no step of the quadratic model: it counts by its cost, and leaves the step's size as it is.
    better = cost < (1.0 - 0.5 * WORTH) * before.cost
    accept = jnp.where(lane.projected, better, accept)
    step_size = jnp.where(lane.projected & better, lane.step_size, step_size)
    # Below its own rounding the cost says nothing, while the gradient still does: there a step counts by that.
    rounding = jnp.finfo(y.dtype).eps * (
        4.0 * before.cost + jnp.sqrt(2.0 * jnp.maximum(before.cost, 0.0) * target_norm_squared)
    )
    by_gradient = (cost <= before.cost + rounding) & (seen.stationarity < 0.9 * before.stationarity)
    by_gradient = by_gradient & ~accept & ~lane.first
    step_size = jnp.where(by_gradient, 10.0 * lane.step_size, step_size)
    accept = (accept | by_gradient) & finite
    project = ~accept & finite & ~lane.first & ~lane.projected
    project &= seen.cost - seen.gain < (1.0 - WORTH) * before.cost
    step_size = jnp.where(project, lane.step_size, step_size)
    y, normal = jax.tree.map(lambda a, b: jnp.where(accept, a, b), (lane.trial, seen), (y, before))
    lengths = jnp.sqrt(jnp.maximum(jnp.diagonal(normal.hessian), 0.0))
    scale = jnp.maximum(lane.scale, lengths)
    safe = jnp.where(scale > 0, scale, 1.0)
    now = info(normal, safe)
    move, _ = descent.step(step_size, descent.query(y, now, descent.init(y, now)))
    move = jnp.where(jnp.isfinite(move), move, 0.0)
    promised = -(jnp.dot(now.grad, move) + 0.5 * jnp.dot(move, now.hessian.mv(move)))
    spent = (promised <= rounding) & ~accept
    # Damping hides what is left to gain along a valley: nearness is judged without it.
    ratio = jnp.where(before.left > 0, seen.left / jnp.where(before.left > 0, before.left, 1.0), 1.0)
    shrinks = jnp.where(accept & ~lane.first, jnp.clip(ratio, 0.0, 1.0), jnp.where(accept, 1.0, lane.shrinks))
    after = normal.stationarity * jnp.sqrt(shrinks)
    aim = _aims(y.dtype)
    near = (normal.stationarity <= rough * aim["close"]) & (after <= rough * aim["nearly"])
    near &= normal.left * shrinks <= rough * aim["little"] * normal.cost
    refused = lane.first & ~finite
    near &= ~project
    finished = (normal.stationarity <= aim["stationary"]) | near | normal.exact | (spent & ~project) | refused
    trial = jnp.where(project, lane.trial + seen.projection, y + move / safe)
    no = jnp.zeros_like(lane.first)
    return _Lane(no, project, accept, y, trial, normal, scale, shrinks, step_size, near, finished, refused)


@jax.jit
def advance(lanes: _Lane, packed, active, target_norm_squared, rough) -> tuple[_Lane, Float[Array, "s q"]]:
    """(the lanes a step on, what the host is to know of them: trial, accepted, finished, refused, near).

    What was seen comes in one array and what is told goes in one: each array by itself costs as long as a step.
    """
    size = lanes.y.shape[1]
    numbers, gradient, projection, hessian = jnp.split(packed, np.cumsum([5, size, size]), axis=1)
    cost, measure, exact, left, gain = numbers.T
    hessian = hessian.reshape(-1, size, size)
    seen = Normal(cost, gradient, hessian, measure, exact > 0, left, projection, gain)
    stepped = jax.vmap(_step, (0, 0, None, None))(lanes, seen, target_norm_squared, rough)
    lanes = jax.tree.map(lambda a, b: jnp.where(active.reshape(-1, *[1] * (a.ndim - 1)), a, b), stepped, lanes)
    said = jnp.stack([lanes.accepted, lanes.finished, lanes.refused, lanes.near], axis=1).astype(lanes.trial.dtype)
    return lanes, jnp.concatenate([lanes.trial, said], axis=1)


def packed_up(seen: Normal, size: int) -> np.ndarray:
    number, free = seen.gradient.shape
    packed = np.zeros((LANES, 5 + size * (2 + size)))
    for k, a in enumerate((seen.cost, seen.stationarity, seen.exact, seen.left, seen.gain)):
        packed[:number, k] = a
    packed[:number, 5 : 5 + free] = seen.gradient
    packed[:number, 5 + size : 5 + size + free] = seen.projection
    packed[:, 5 + 2 * size :].reshape(LANES, size, size)[:number, :free, :free] = seen.hessian
    return packed


@functools.lru_cache(maxsize=16)
def fresh(size: int, step_size: float, double: bool) -> _Lane:
    zeros, no, none = np.zeros((LANES, size)), np.zeros(LANES, bool), np.zeros(LANES)
    normal = Normal(none, zeros, np.zeros((LANES, size, size)), none, no, none, zeros, none)
    fresh = _Lane(~no, no, no, zeros, zeros, normal, zeros, none + 1.0, np.full(LANES, step_size), no, no, no)
    return jax.tree.map(jax.device_put, fresh)


def padded_size(free: int) -> int:
    """The numbers that a step's program is compiled for, of which so many are free."""
    return max(8, 1 << (free - 1).bit_length())


def compile_step(free: int) -> None:
    """Compile the program of a step for so many free numbers, before there is a model."""
    size, no = padded_size(free), np.zeros(LANES, bool)
    lanes, none = fresh(size, 1.0, is_double()), np.zeros((LANES, 5 + size * (2 + size)))
    advance(lanes, none, no, np.asarray(1.0), np.asarray(1.0))[1].block_until_ready()
