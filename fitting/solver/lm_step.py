"""One step of Levenberg–Marquardt: Optimistix's damped Newton descent and trust region on normal equations.

Optimistix's `LevenbergMarquardt` wants the residual vector and its Jacobian; for a full table these are gigabytes. Here
its components work on `FunctionInfo.EvalGradHessian`, which streaming supplies, an `Arrow` in place of the Hessian. The
formulas are those of XLA's program and of the compiled loop.
"""

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gonio.fitting.problem.arrow import Arrow, module_of
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains, Mapped, at_bounds, near_origin
from gonio.fitting.problem.readings import AnyArray

AIM = 1e-9  # the aim; a fit counts as stationary from 1e-6 on
NEARLY, LITTLE = 1e-7, 1e-13  # or this near, where the next step promises no more than this share of the cost
WORTHWHILE = 1e-3  # of what is left to gain, and of the cost: what a projection must promise
GROWTH = 2.0  # of the step's size where a projection is taken
CLOSE = 1e-5  # or this near, where steps are seen to shrink so fast that the next one will do
IN_SINGLE = {"stationary": 3e-6, "nearly": 3e-5, "little": 1e-9, "close": 1e-3}  # the same in single precision

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


def stationarity(d: Domains, p: AnyArray, equations: NormalEquations) -> Stationarity:
    """The projected gradient at p, any leading axes; all in the order of the arrow."""
    xp, (low, high) = module_of(equations.gradient), at_bounds(d, p)
    active = (low & (equations.gradient >= 0)) | (high & (equations.gradient <= 0))
    length2 = xp.asarray(equations.matrix.diagonal())
    silent = length2 <= 0
    norm = xp.sqrt(2.0 * xp.maximum(xp.asarray(equations.cost)[..., None], 1e-300))
    scale = xp.sqrt(xp.where(silent, 1.0, length2)) * norm
    share = xp.where(active | silent, 0.0, xp.abs(equations.gradient) / scale)
    return Stationarity(xp.max(share, axis=-1, initial=0.0), active, silent)


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


class Lane(NamedTuple):
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
    lane: Lane, trial: Normal, cost: Float[AnyArray, ""], finite: Bool[AnyArray, ""], rounding: Float[AnyArray, ""]
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


def step(lane: Lane, latest: Normal, target_norm_squared: Float[AnyArray, ""], rough: Float[AnyArray, ""]) -> Lane:
    """One damped Newton step, scaled as in MINPACK [Moré 1978], from what was evaluated at the trial point.

    A trial whose cost is not finite is a rejected step. Ends when stationary, exact, or when a step that could only
    change the cost by its rounding brings the gradient no further down; `rough`: relaxes what is stationary.
    """
    descent, _, info, _ = _components()
    before = lane.normal
    finite = jnp.isfinite(latest.cost) & jnp.all(jnp.isfinite(latest.gradient))
    finite &= functools.reduce(operator.and_, (jnp.all(jnp.isfinite(a)) for a in latest.hessian if a.size))
    cost = jnp.where(finite, latest.cost, jnp.inf)
    rounding = jnp.finfo(lane.y.dtype).eps * (
        4.0 * before.cost + jnp.sqrt(2.0 * jnp.maximum(before.cost, 0.0) * target_norm_squared)
    )
    accept, project, step_size = _decide(lane, latest, cost, finite, rounding)
    there = near_origin(lane.trial), latest
    y, normal = jax.tree.map(lambda a, b: jnp.where(accept, a, b), there, (lane.y, before))
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
    return Lane(no, project, accept, y, trial, normal, scale, shrinks, step_size, near, finished, refused)


def evaluated(
    d: Domains, mapped: Mapped, equations: NormalEquations, target_norm_squared: float | AnyArray, linear: AnyArray
) -> Normal:
    """What is known at some points, by the coordinates; any leading axes."""
    xp, rounding = module_of(equations.gradient), (30.0 * eps()) ** 2 * target_norm_squared
    with np.errstate(all="ignore"):  # what is not finite is a rejected step
        # The map's curvature is exact and free; negative curvature would spoil positive definiteness and is left out.
        bend = xp.maximum(equations.gradient * mapped.curvature, 0.0)
        hessian = equations.matrix.scaled(mapped.slope).plus_diagonal(bend)
        measure = stationarity(d, mapped.p, equations).projected_gradient
        exact = 2.0 * equations.cost <= rounding
        gradient = equations.gradient * mapped.slope
        _, promised = _newton(hessian, gradient, np.ones(linear.shape, bool))
        projection, gain = _newton(hessian, gradient, linear)
    return Normal(equations.cost, gradient, hessian, measure, exact, promised, projection, gain)


def _newton(hessian: Arrow, gradient: AnyArray, kept: AnyArray) -> tuple[Any, Any]:
    """(undamped Newton steps (S, P) in the numbers that are `kept` (P,) alone, what they take off the cost (S,)).

    In the linear numbers alone [Golub & Pereyra 1973]: a trial in a curved valley is often refused for albedos and
    scales that do not fit its shapes.
    """
    xp = module_of(gradient)
    slope, lengths = xp.where(kept, gradient, 0.0), xp.sqrt(hessian.diagonal())
    lengths = xp.where(lengths > 0, lengths, 1.0)
    scaled = hessian.scaled(1.0 / lengths)
    scaled = scaled.plus_diagonal(xp.where(scaled.diagonal() > 0, 1e-12, 1.0)).restricted(kept)
    move = -scaled.solved(slope / lengths) / lengths
    move = xp.where(xp.isfinite(move).all(axis=-1, keepdims=True), move, 0.0)
    return move, -0.5 * xp.sum(move * xp.where(xp.isfinite(slope), slope, 0.0), axis=-1)
