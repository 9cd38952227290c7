"""Levenberg–Marquardt on streamed normal equations, several descents at once, made of Optimistix's own parts.

Optimistix's `LevenbergMarquardt` wants the residual vector and its Jacobian; for a full table these are gigabytes. Here
its damped Newton descent and its trust region work on `FunctionInfo.EvalGradHessian`, which streaming supplies. A step
is a program of its own that knows nothing of the model: it is compiled once for all models of up to 8 free numbers.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from gonio.fitting.domains import Domains, to_parameters
from gonio.fitting.equations import LANES, Samples, Sums, pages, sums
from gonio.fitting.structure import Structure, count

MAX_STEPS = 200
STATIONARY = 1e-9  # the aim; DESIGN's test asks for 1e-6
NEARLY, LITTLE = 1e-7, 1e-13  # or this near, where the next step promises no more than this share of the cost
WORTH = 1e-3  # of the cost: what a projection must promise
UNDAMPED = 1e8  # the first step's size from near a minimum; 1 is MINPACK's from afar
_EPS = 2.220446049250313e-16


class Problem(eqx.Module):
    """All that the cost depends on besides the free numbers."""

    structure: Structure = eqx.field(static=True)
    loss: str = eqx.field(static=True)
    fixed: tuple[dict, ...]
    domains: Domains
    data: Samples
    size2: Float[Array, ""]  # ‖data‖², of the weighted targets


class Normal(NamedTuple):
    """Cost, gradient and Hessian in unconstrained coordinates, and how far from stationary; any leading axis."""

    cost: Float[Array, ""]
    gradient: Float[Array, " p"]
    hessian: Float[Array, "p p"]
    stationarity: Float[Array, ""]
    exact: Bool[Array, ""]


class Ends(NamedTuple):
    """Where S descents ended: parameters, the sums there or one step before, and what was seen; S leading."""

    p: np.ndarray
    total: Sums
    stationarity: np.ndarray
    exact: np.ndarray
    steps: np.ndarray
    successful: np.ndarray


def at_bounds(d: Domains, p: Float[Array, "*s p"], xp=np) -> tuple[Array, Array]:
    """Which parameters lie on their lower, and which on their upper bound (to 1e-9 of the domain's size there)."""
    span = xp.minimum(d.high - d.low, 1.0)
    return p - d.low <= 1e-9 * span, d.high - p <= 1e-9 * span


def stationarity(d: Domains, p, total: Sums, xp=np) -> tuple[Float[Array, "*s"], Array, Array]:
    """(max_j |J_jᵀr|/(‖J_j‖‖r‖), pinned, silent): pinned sit on a bound that the cost pushes against, and silent
    parameters do not move the residuals at all; neither counts in the maximum. Any leading axes.
    """
    low, high = at_bounds(d, p, xp)
    pinned = (low & (total.gradient >= 0)) | (high & (total.gradient <= 0))
    length2 = xp.diagonal(total.matrix, axis1=-2, axis2=-1)
    silent = length2 <= 0
    scale = xp.sqrt(xp.where(silent, 1.0, length2) * 2.0 * xp.maximum(xp.asarray(total.cost)[..., None], 1e-300))
    share = xp.where(pinned | silent, 0.0, xp.abs(total.gradient) / scale)
    return xp.max(share, axis=-1, initial=0.0), pinned, silent


def normal_at(
    problem: Problem, data: list[Samples], x: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, Sums, Normal]:
    """(parameters, sums, normal equations) at coordinates x (S, P), of the active ones; `data` in pages."""
    d = problem.domains
    p, slope, curvature = to_parameters(d, x, np)
    total, _ = sums(problem.structure, problem.loss, p, problem.fixed, data, active)
    with np.errstate(all="ignore"):  # what is not finite is a rejected step
        # The map's curvature is exact and free; negative curvature would spoil positive definiteness and is left out.
        bend = np.maximum(total.gradient * curvature, 0.0)
        hessian = total.matrix * slope[:, :, None] * slope[:, None, :]
        at = np.arange(x.shape[1])
        hessian[:, at, at] += bend
        measure, _, _ = stationarity(d, p, total)
        exact = 2.0 * total.cost <= (30.0 * _EPS) ** 2 * float(problem.size2)
        return p, total, Normal(total.cost, total.gradient * slope, hessian, measure, exact)


class _Lane(NamedTuple):
    """One descent between two evaluations: where it is, what it knows there, and where it wants to look next."""

    first: Bool[Array, ""]
    projected: Bool[Array, ""]  # whether the trial is a refused one whose linear numbers were solved for
    accepted: Bool[Array, ""]
    y: Float[Array, " p"]
    trial: Float[Array, " p"]
    normal: Normal
    scale: Float[Array, " p"]
    search: Any
    near: Bool[Array, ""]
    finished: Bool[Array, ""]
    refused: Bool[Array, ""]


_DESCENT = optx.DampedNewtonDescent(linear_solver=lx.Cholesky())
_SEARCH = optx.ClassicalTrustRegion(high_cutoff=0.75, low_cutoff=1e-4, high_constant=4.0, low_constant=0.35)


def _info(normal: Normal, scale):
    matrix = normal.hessian / (scale[:, None] * scale[None, :])
    # What no residual depends on has an empty row: a unit there keeps Cholesky happy and the parameter still.
    matrix = matrix + jnp.diag(jnp.where(jnp.diagonal(matrix) > 0, 0.0, 1.0))
    operator = lx.MatrixLinearOperator(matrix, lx.positive_semidefinite_tag)
    return optx.FunctionInfo.EvalGradHessian(normal.cost, normal.gradient / scale, operator)


def _step(lane: _Lane, seen: Normal, linear, size2, rough) -> _Lane:
    """One damped Newton step, scaled as in MINPACK [Moré 1978], after the trial point has been `seen`.

    A trial whose cost is not finite is a rejected step. Ends when stationary, exact, or when a step that could only
    change the cost by its rounding brings the gradient no further down; `rough`: relaxes what is stationary.
    """
    y, before = lane.y, lane.normal
    finite = jnp.isfinite(seen.cost) & jnp.all(jnp.isfinite(seen.gradient)) & jnp.all(jnp.isfinite(seen.hessian))
    cost = jnp.where(finite, seen.cost, jnp.inf)
    step_size, accept, _, search = _SEARCH.step(
        lane.first, y, lane.trial, _info(before, jnp.ones_like(y)), optx.FunctionInfo.Eval(cost), lane.search
    )
    # A projected trial is no step of the quadratic model: it counts by its cost, and leaves the step's size as it is.
    better = cost < (1.0 - 0.5 * WORTH) * before.cost
    accept = jnp.where(lane.projected, better, accept)
    step_size = jnp.where(lane.projected & better, lane.search.step_size, step_size)
    # Below its own rounding the cost says nothing, while the gradient still does: there a step counts by that.
    rounding = _EPS * (4.0 * before.cost + jnp.sqrt(2.0 * jnp.maximum(before.cost, 0.0) * size2))
    by_gradient = (cost <= before.cost + rounding) & (seen.stationarity < 0.9 * before.stationarity)
    by_gradient = by_gradient & ~accept & ~lane.first
    step_size = jnp.where(by_gradient, 10.0 * lane.search.step_size, step_size)
    search = eqx.tree_at(lambda s: s.step_size, search, step_size)
    accept = (accept | by_gradient) & finite
    projection, gain = _projection(seen, linear)
    project = ~accept & finite & ~lane.first & ~lane.projected & (seen.cost - gain < (1.0 - WORTH) * before.cost)
    step_size = jnp.where(project, lane.search.step_size, step_size)
    search = eqx.tree_at(lambda s: s.step_size, search, step_size)
    y, normal = jax.tree.map(lambda a, b: jnp.where(accept, a, b), (lane.trial, seen), (y, before))
    lengths = jnp.sqrt(jnp.maximum(jnp.diagonal(normal.hessian), 0.0))
    scale = jnp.maximum(lane.scale, lengths)
    safe = jnp.where(scale > 0, scale, 1.0)
    info = _info(normal, safe)
    descent = _DESCENT.query(y, info, _DESCENT.init(y, info))
    move, result = _DESCENT.step(step_size, descent)
    move = jnp.where(jnp.isfinite(move), move, 0.0)
    promised = -(jnp.dot(info.grad, move) + 0.5 * jnp.dot(move, info.hessian.mv(move)))
    spent = (promised <= rounding) & ~accept
    # Damping hides what is left to gain along a valley: nearness is judged without it.
    left = 0.5 * jnp.dot(info.grad, jnp.linalg.solve(info.hessian.as_matrix() + 1e-12 * jnp.eye(y.size), info.grad))
    near = (normal.stationarity <= rough * NEARLY) & (jnp.abs(left) <= rough * LITTLE * normal.cost)
    refused = (lane.first & ~finite) | (result != optx.RESULTS.successful)
    near &= ~project
    finished = (normal.stationarity <= STATIONARY) | near | normal.exact | (spent & ~project) | refused
    trial = jnp.where(project, lane.trial + projection, y + move / safe)
    no = jnp.zeros_like(lane.first)
    return _Lane(no, project, accept, y, trial, normal, scale, search, near, finished, refused)


def _projection(seen: Normal, linear):
    """(Newton step in the linear numbers alone, what that takes off the cost) [Golub & Pereyra 1973].

    A trial in a curved valley is often refused for albedos and scales that do not fit its shapes.
    """
    both = linear[:, None] & linear[None, :]
    diagonal = jnp.where(linear & (jnp.diagonal(seen.hessian) > 0), 1e-12 * jnp.diagonal(seen.hessian), 1.0)
    gradient = jnp.where(linear, seen.gradient, 0.0)
    move = -jnp.linalg.solve(jnp.where(both, seen.hessian, 0.0) + jnp.diag(diagonal), gradient)
    move = jnp.where(jnp.isfinite(move), move, 0.0)
    return move, -0.5 * jnp.dot(move, gradient)


@jax.jit
def _advance(lanes: _Lane, seen: Normal, active, linear, size2, rough) -> _Lane:
    stepped = jax.vmap(_step, (0, 0, None, None, None))(lanes, seen, linear, size2, rough)
    return jax.tree.map(lambda a, b: jnp.where(active.reshape(-1, *[1] * (a.ndim - 1)), a, b), stepped, lanes)


@functools.lru_cache(maxsize=16)
def _fresh(size: int, step_size: float) -> _Lane:
    zeros, no = np.zeros((LANES, size)), np.zeros(LANES, bool)
    normal = Normal(np.zeros(LANES), zeros, np.zeros((LANES, size, size)), np.zeros(LANES), no)
    one = jax.tree.map(lambda a: jnp.asarray(a[0]), normal)
    search = _SEARCH.init(jnp.zeros(size), _info(one, jnp.ones(size)))
    search = jax.tree.map(lambda a: np.full((LANES, *np.shape(a)), step_size), search)
    return _Lane(~no, no, no, zeros, zeros, normal, zeros, search, no, no, no)


def _padded(a: np.ndarray, size: int, axes: int) -> np.ndarray:
    wide = np.zeros((LANES, *[size] * axes), a.dtype)
    wide[tuple(slice(n) for n in a.shape)] = a
    return wide


def minimise(problem: Problem, x: np.ndarray, near: bool = False, rough: float = 1.0) -> Ends:
    """The ends of the descents from unconstrained coordinates x (S, P), at most `LANES` of them.

    `near`: they begin near minima, and need no damping at first. `rough`: how much less stationary may do.
    """
    number, free = x.shape
    size = max(8, 1 << (free - 1).bit_length())
    lanes = _fresh(size, UNDAMPED if near else 1.0)._replace(trial=_padded(x, size, 1), y=_padded(x, size, 1))
    active, steps = np.arange(LANES) < number, np.zeros(number, int)
    kept, data = None, pages(problem.data)
    linear = np.zeros(size, bool)
    for g in problem.structure.groups:
        linear[g.first : g.first + count(problem.structure, g)] = g.linear
    size2, rough = np.asarray(float(problem.size2)), np.asarray(float(rough))
    for _ in range(MAX_STEPS):
        p, total, seen = normal_at(problem, data, np.asarray(lanes.trial)[:number, :free], active[:number])
        wide = Normal(*(_padded(a, size, a.ndim - 1) for a in seen))
        lanes = _advance(lanes, wide, active, linear, size2, rough)
        accepted = np.asarray(lanes.accepted)[:number] & active[:number]
        now = (p, *total, seen.stationarity, seen.exact)
        kept = now if kept is None else tuple(
            np.where(accepted.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(now, kept, strict=True)
        )  # fmt: skip
        steps += active[:number]
        active = active & ~np.asarray(lanes.finished)
        if not active.any():
            break
    successful = np.asarray(lanes.finished & ~lanes.refused)[:number]
    p, cost, gradient, matrix, measure, exact = kept
    # So near, the last step is as good as taken: it promises less than evaluations could tell.
    last = to_parameters(problem.domains, np.asarray(lanes.trial)[:number, :free], np)[0]
    p = np.where(np.asarray(lanes.near)[:number, None] & ~exact[:, None], last, p)
    return Ends(p, Sums(cost, gradient, matrix), measure, exact, steps, successful)
