"""Levenberg–Marquardt on streamed normal equations, several descents at once, made of Optimistix's own parts.

Optimistix's `LevenbergMarquardt` wants the residual vector and its Jacobian; for a full table these are gigabytes. Here
its damped Newton descent and its trust region work on `FunctionInfo.EvalGradHessian`, which streaming supplies.
"""

import contextlib
import functools
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.problem.blocks import LANES, Samples, pages
from gonio.fitting.problem.domains import Domains, to_parameters
from gonio.fitting.problem.normal_equations import Sums, sums
from gonio.fitting.problem.parameterisation import Structure, count
from gonio.fitting.solver.convergence import eps, is_double
from gonio.fitting.solver.lm_step import Normal, advance, fresh, packed_up, padded_size

MAX_STEPS = 200
UNDAMPED, DAMPED = 1e8, 100.0  # the first step's size from near a minimum, and from afar as MINPACK's
HOPE = 4.0  # times as much as a Newton step promises: more will not come of a descent near a minimum


class Problem(eqx.Module):
    """All that the cost depends on besides the free numbers."""

    structure: Structure = eqx.field(static=True)
    loss: str = eqx.field(static=True)
    fixed: tuple[dict, ...]
    domains: Domains
    data: Samples
    target_norm_squared: Float[Array, ""]  # ‖data‖², of the weighted targets


class Ends(NamedTuple):
    """Where S descents ended: parameters, the sums there or one step before, and what was seen; S leading.

    Where the last step was not looked at any more, the cost is what it promised.
    """

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
        exact = 2.0 * total.cost <= (30.0 * eps()) ** 2 * float(problem.target_norm_squared)
        gradient = total.gradient * slope
        (_, projection), (left, gain) = _newton(hessian, gradient, _stepping(problem.structure))
        return p, total, Normal(total.cost, gradient, hessian, measure, exact, left, projection, gain)


@functools.lru_cache(maxsize=256)
def _stepping(s: Structure) -> np.ndarray:
    """All numbers, and the linear ones alone, (2, P)."""
    linear = np.array([g.linear for g in s.groups for _ in range(count(s, g))], bool)
    return np.stack([np.ones_like(linear), linear])


def _newton(hessian: np.ndarray, gradient: np.ndarray, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(undamped Newton steps (M, S, P), each in the numbers `of` (M, P) alone, what they take off the cost (M, S)).

    In the linear numbers alone [Golub & Pereyra 1973]: a trial in a curved valley is often refused for albedos and
    scales that do not fit its shapes.
    """
    good = np.isfinite(hessian).all((1, 2)) & np.isfinite(gradient).all(1)
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


def minimise(
    problem: Problem,
    x: np.ndarray,
    near: bool = False,
    rough: float = 1.0,
    rivals: bool = False,
    enough: float = 0.0,
    most: int = MAX_STEPS,
) -> Ends:
    """The ends of the descents from unconstrained coordinates x (S, P), at most `LANES` of them.

    `near`: they begin near minima, and need no damping at first. `rough`: how much less stationary may do. `rivals`:
    only the lowest end is asked for, and what will not come down to it may stop where it is. `enough`: of the cost may
    be left to gain, by what a Newton step promises. `most`: steps.
    """
    number, free = x.shape
    size = padded_size(free)
    start = np.zeros((LANES, size))
    start[:number, :free] = x
    lanes, trial = fresh(size, UNDAMPED if near else DAMPED, is_double())._replace(trial=start, y=start), x
    active, steps = np.arange(LANES) < number, np.zeros(number, int)
    kept, data = None, pages(problem.data)
    target_norm_squared, rough = np.asarray(float(problem.target_norm_squared)), np.asarray(float(rough))
    for _ in range(most):
        p, total, seen = normal_at(problem, data, trial, active[:number])
        lanes, told = advance(lanes, packed_up(seen, size), active, target_norm_squared, rough)
        told = np.asarray(told)[:number]
        trial, (said_accepted, finished, refused, settled) = told[:, :free], told[:, size:].T > 0
        accepted = said_accepted & active[:number]
        now = (p, *total, seen.stationarity, seen.exact, seen.left)
        kept = now if kept is None else tuple(
            np.where(accepted.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(now, kept, strict=True)
        )  # fmt: skip
        steps += active[:number]
        active[:number] &= ~(finished | (accepted & (seen.left < enough)))
        if rivals:
            active[:number] &= ~(kept[1] - HOPE * kept[-1] > np.min(kept[1]))
        if not active.any():
            break
    p, cost, gradient, matrix, measure, exact, left = kept
    # So near, the last step is as good as taken.
    settled = (settled | (left < enough)) & ~exact
    p = np.where(settled[:, None], to_parameters(problem.domains, trial, np)[0], p)
    cost = np.where(settled, cost - left, cost)
    return Ends(p, Sums(cost, gradient, matrix), measure, exact, steps, finished & ~refused)
