"""Levenberg–Marquardt on streamed normal equations, made of Optimistix's own parts.

Optimistix's `LevenbergMarquardt` wants the residual vector and its Jacobian; for a full table these are gigabytes. Here
its damped Newton descent and its trust region work on `FunctionInfo.EvalGradHessian`, which streaming supplies.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float

from gonio.fitting.domains import Domains, to_parameters
from gonio.fitting.equations import Samples, Sums, sums
from gonio.fitting.structure import Structure

MAX_STEPS = 200
STATIONARY = 1e-9  # the aim; DESIGN's test asks for 1e-6
_EPS = 2.220446049250313e-16


class Problem(eqx.Module):
    """All that the cost depends on besides the free numbers."""

    structure: Structure = eqx.field(static=True)
    loss: str = eqx.field(static=True)
    fixed: tuple[dict, ...]
    domains: Domains
    data: Samples
    size2: Float[Array, ""]  # ‖data‖², of the weighted targets


class Normal(eqx.Module):
    """Gradient and Hessian in unconstrained coordinates, and how far from stationary."""

    gradient: Float[Array, " p"]
    hessian: Float[Array, "p p"]
    stationarity: Float[Array, ""]
    exact: Bool[Array, ""]


def at_bounds(d: Domains, p: Float[Array, " p"], xp=jnp) -> tuple[Array, Array]:
    """Which parameters lie on their lower, and which on their upper bound (to 1e-9 of the domain's size there)."""
    span = xp.minimum(d.high - d.low, 1.0)
    return p - d.low <= 1e-9 * span, d.high - p <= 1e-9 * span


def stationarity(d: Domains, p, total: Sums, xp=jnp) -> tuple[Float[Array, ""], Array, Array]:
    """(max_j |J_jᵀr|/(‖J_j‖‖r‖), pinned, silent): pinned sit on a bound that the cost pushes against, and silent
    parameters do not move the residuals at all; neither counts in the maximum.
    """
    low, high = at_bounds(d, p, xp)
    pinned = (low & (total.gradient >= 0)) | (high & (total.gradient <= 0))
    length2 = xp.diagonal(total.matrix)
    silent = length2 <= 0
    scale = xp.sqrt(xp.where(silent, 1.0, length2) * 2.0 * xp.maximum(total.cost, 1e-300))
    share = xp.where(pinned | silent, 0.0, xp.abs(total.gradient) / scale)
    return xp.max(share, initial=0.0), pinned, silent


def cost_and_normal(x: Float[Array, " p"], problem: Problem) -> tuple[Float[Array, ""], Normal]:
    """The cost ½Σr² at unconstrained coordinates, with what Optimistix needs to step from there."""
    p, slope, curvature = to_parameters(problem.domains, x)
    total = sums(problem.structure, problem.loss, p, problem.fixed, problem.data)
    # The map's curvature is exact and free; negative curvature would spoil positive definiteness and is left out.
    bend = jnp.maximum(total.gradient * curvature, 0.0)
    hessian = total.matrix * slope[:, None] * slope[None, :] + jnp.diag(bend)
    measure, _, _ = stationarity(problem.domains, p, total)
    exact = 2.0 * total.cost <= (30.0 * _EPS) ** 2 * problem.size2
    return total.cost, Normal(total.gradient * slope, hessian, measure, exact)


class _State(eqx.Module):
    first: Bool[Array, ""]
    trial: Float[Array, " p"]
    cost: Float[Array, ""]
    normal: Normal
    scale: Float[Array, " p"]
    search: Any
    finished: Bool[Array, ""]
    result: optx.RESULTS


class StreamedLevenbergMarquardt(optx.AbstractMinimiser):
    """Damped Newton descent with a trust region on (cost, `Normal`), scaled as in MINPACK [Moré 1978].

    A trial step whose cost is not finite is a rejected step. Stops when stationary, exact, or when a step that could
    only change the cost by its rounding brings the gradient no further down.
    """

    rtol: float = 0.0
    atol: float = 0.0
    norm: Any = optx.max_norm
    descent: optx.DampedNewtonDescent = optx.DampedNewtonDescent(linear_solver=lx.Cholesky())
    search: optx.ClassicalTrustRegion = optx.ClassicalTrustRegion(
        high_cutoff=0.75, low_cutoff=1e-4, high_constant=10.0, low_constant=0.2
    )

    def _info(self, cost, normal: Normal, scale):
        matrix = normal.hessian / (scale[:, None] * scale[None, :])
        # What no residual depends on has an empty row: a unit there keeps Cholesky happy and the parameter still.
        matrix = matrix + jnp.diag(jnp.where(jnp.diagonal(matrix) > 0, 0.0, 1.0))
        operator = lx.MatrixLinearOperator(matrix, lx.positive_semidefinite_tag)
        return optx.FunctionInfo.EvalGradHessian(cost, normal.gradient / scale, operator)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        normal = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), aux_struct)
        cost, one = jnp.zeros(f_struct.shape, f_struct.dtype), jnp.ones_like(y)
        search = self.search.init(y, self._info(cost, normal, one))
        no = jnp.array(False)
        return _State(jnp.array(True), y, cost, normal, jnp.zeros_like(y), search, no, optx.RESULTS.successful)

    def step(self, fn, y, args, options, state, tags):
        cost, normal = fn(state.trial, args)
        finite = jnp.isfinite(cost) & jnp.all(jnp.isfinite(normal.gradient)) & jnp.all(jnp.isfinite(normal.hessian))
        cost = jnp.where(finite, cost, jnp.inf)
        old = self._info(state.cost, state.normal, jnp.ones_like(y))
        step_size, accept, _, search = self.search.step(
            state.first, y, state.trial, old, optx.FunctionInfo.Eval(cost), state.search
        )
        # Below its own rounding the cost says nothing, while the gradient still does: there a step counts by that.
        rounding = _EPS * (4.0 * state.cost + jnp.sqrt(2.0 * jnp.maximum(state.cost, 0.0) * args.size2))
        by_gradient = (cost <= state.cost + rounding) & (normal.stationarity < 0.9 * state.normal.stationarity)
        by_gradient = by_gradient & ~accept & ~state.first
        step_size = jnp.where(by_gradient, 10.0 * state.search.step_size, step_size)
        search = eqx.tree_at(lambda s: s.step_size, search, step_size)
        accept = (accept | by_gradient) & finite
        pick = lambda new, before: jax.tree.map(lambda a, b: jnp.where(accept, a, b), new, before)  # noqa: E731
        y, cost, normal = pick((state.trial, cost, normal), (y, state.cost, state.normal))
        lengths = jnp.sqrt(jnp.maximum(jnp.diagonal(normal.hessian), 0.0))
        scale = jnp.maximum(state.scale, lengths)
        safe = jnp.where(scale > 0, scale, 1.0)
        info = self._info(cost, normal, safe)
        descent = self.descent.query(y, info, self.descent.init(y, info))
        move, result = self.descent.step(step_size, descent)
        move = jnp.where(jnp.isfinite(move), move, 0.0)
        promised = -(jnp.dot(info.grad, move) + 0.5 * jnp.dot(move, info.hessian.mv(move)))
        spent = (promised <= rounding) & ~accept
        stationary = normal.stationarity <= STATIONARY
        refused = (state.first & ~finite) | (result != optx.RESULTS.successful)
        finished = stationary | normal.exact | spent | refused
        state = _State(
            jnp.array(False), y + move / safe, cost, normal, scale, search, finished,
            optx.RESULTS.where(refused, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful),
        )  # fmt: skip
        return y, state, normal

    def terminate(self, fn, y, args, options, state, tags):
        return state.finished, state.result

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return y, aux, {"cost": state.cost}


@eqx.filter_jit
def minimise(problem: Problem, x: Float[Array, " p"]):
    """(parameters, cost, `Normal`, steps, whether Optimistix calls it successful) of one descent from x."""
    found = optx.minimise(
        cost_and_normal, StreamedLevenbergMarquardt(), x, problem, has_aux=True, max_steps=MAX_STEPS, throw=False
    )
    p, _, _ = to_parameters(problem.domains, found.value)
    return p, found.stats["cost"], found.aux, found.stats["num_steps"], found.result == optx.RESULTS.successful
