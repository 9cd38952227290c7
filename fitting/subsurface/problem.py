"""The least-squares problem of one channel of a profile: σa and σs' of a model that spots of finite size read."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.subsurface.base import MOST, AbstractBSSRDF

STARTS = 3
"""Descents, from the best points of a grid of mean free paths and albedos."""
ALBEDOS = (0.2, 0.6, 0.9, 0.98, 0.996, 0.9993)
LENGTHS = 16
POLISH = 60
LEAST_SHARE = 1 / 32
"""Of a Gauss–Newton step."""
NODES = 10
"""Of a panel of the spots' rule: right to 1e-6 of a reading."""
NEAR_ZERO = 1e-6
"""√σa that stands for 0, where every model has a slope."""
NEGLIGIBLE = 1e-8
"""σa over σs' that no readings tell from 0."""
STATIONARY = 1e-6
EXACT = 1e-6
"""Of the readings: a residual that the spots' rule may leave where there is no noise."""


class ProfileData(NamedTuple):
    """Readings y (n,) of one channel with weights, 0 where there is none, and the rule of their spots (d, m).

    `which` (n,) says the distance of each; the same distance on two sides is evaluated once.
    """

    r: np.ndarray
    rule: np.ndarray
    which: np.ndarray
    y: np.ndarray
    weight: np.ndarray


class Program(NamedTuple):
    """Compiled functions of one model; x (2,) is (√σa, ln σs'), in which a profile is nearly even."""

    costs: Callable[..., jax.Array]
    descend: Callable[..., jax.Array]
    linearised: Callable[..., tuple[jax.Array, jax.Array]]


@dataclasses.dataclass(frozen=True)
class ProfileOptimum:
    """The end of a fit: x (2,), weighted residuals (n,), their Jacobian (n, 2), and how it was reached.

    The Jacobian is by x; `at_bound` by σa in place of its root.
    """

    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    gradient: float
    """Largest projected gradient, relative to the sizes of its factors."""
    exact: bool
    agreed: int
    at_bound: bool
    """Whether no absorption fits best."""
    rounding: float
    """‖r‖ up to which it is exact."""

    @property
    def root(self) -> float:
        """√σa."""
        return 0.0 if self.at_bound else abs(float(self.x[0])) + NEAR_ZERO

    @property
    def reduced(self) -> float:
        """σs'."""
        return float(np.exp(self.x[1]))

    @property
    def cost(self) -> float:
        """Σ r²."""
        return float(self.residual @ self.residual)

    @property
    def converged(self) -> bool:
        """Stationary, or exact."""
        return bool(np.isfinite(self.cost)) and (self.exact or self.gradient <= STATIONARY)


@functools.cache
def program(kind: type[AbstractBSSRDF]) -> Program:
    """The functions of a model, compiled once for each number of offsets."""

    def means(x: jax.Array, eta: jax.Array, data: ProfileData) -> jax.Array:
        parameters: Any = {"sigma_a": (jnp.abs(x[0]) + NEAR_ZERO) ** 2, "sigma_s": jnp.exp(x[1]), "eta": eta}
        model = kind(**parameters)
        values = jax.vmap(model.profile)(data.r.reshape(-1)).reshape(data.r.shape)
        return (jnp.sum(data.rule * values, axis=1) * model.transmittance(jnp.ones(())) ** 2)[data.which]

    def residual(x: jax.Array, args: tuple[jax.Array, jax.Array, jax.Array, ProfileData]) -> jax.Array:
        fixed, free, eta, data = args
        return (means(jnp.where(free, x, fixed), eta, data) - data.y) * data.weight

    def cost(x: jax.Array, args: tuple) -> jax.Array:
        r = residual(x, args)
        return jnp.sum(r * r)

    def descend(x: jax.Array, args: tuple) -> jax.Array:
        # A third of a second, which pages and quantities of tables do not need
        import lineax as lx
        import optimistix as optx

        solver = optx.LevenbergMarquardt(rtol=1e-6, atol=1e-6, linear_solver=lx.Normal(lx.Cholesky()))
        return optx.least_squares(residual, solver, x, args, max_steps=100, throw=False).value

    def linearised(x: jax.Array, args: tuple) -> tuple[jax.Array, jax.Array]:
        return residual(x, args), jax.jacfwd(residual)(x, args)

    def descents(starts: jax.Array, args: tuple) -> jax.Array:
        # One after another: a loop over them side by side takes longer to compile than they take to run
        return jax.lax.map(lambda x: descend(x, args), starts)

    return Program(jax.jit(jax.vmap(cost, in_axes=(0, None))), jax.jit(descents), jax.jit(linearised))


def solve(
    kind: type[AbstractBSSRDF], data: ProfileData, eta: float, start: np.ndarray, free: np.ndarray
) -> ProfileOptimum:
    """The optimum of one channel, in double precision whatever the caller computes in: single leaves no sure optimum.

    Args:
        kind: the model.
        data: readings, weights and spots.
        eta: index of the material.
        start: x (2,) to begin at too, and where what is not free stays; NaN where nothing is known.
        free: which of both numbers the fit moves.
    """
    with jax.enable_x64(True):
        return _solved(program(kind), data, eta, start, free)


def _solved(compiled: Program, data: ProfileData, eta: float, start: np.ndarray, free: np.ndarray) -> ProfileOptimum:
    fixed = np.where(np.isnan(start), 0.0, start)
    args = (fixed, free, np.asarray(eta), data)
    rounding = EXACT * float(np.linalg.norm(data.y * data.weight))
    grid = _grid(data, start)
    costs = np.nan_to_num(np.asarray(compiled.costs(grid, args)), nan=np.inf)
    ends = np.asarray(compiled.descend(grid[np.argsort(costs)[:STARTS]], args))
    costs = np.asarray(compiled.costs(np.resize(ends, grid.shape), args))[:STARTS]  # one shape, one program
    costs = np.nan_to_num(costs, nan=np.inf)
    x, residual, jacobian = _polished(compiled, np.where(free, ends[np.argmin(costs)], fixed), free, args)
    at_bound = False
    if free[0]:
        # Without absorption: x and −x are one material, so that the cost has a kink there and no slope of 0
        only = free & np.array([False, True])
        bound = _polished(compiled, np.array([0.0, x[1]]), only, (np.zeros(2), free, *args[2:]))
        lower = bound[1] @ bound[1] <= residual @ residual - rounding**2
        at_bound = bool(lower or x[0] ** 2 <= NEGLIGIBLE * np.exp(x[1]))
        if at_bound:
            x, residual, jacobian, free = bound[0], bound[1], bound[2].copy(), only
            jacobian[:, 0] = _absorbing(compiled, x, residual, args)
    sizes = np.linalg.norm(jacobian, axis=0) * np.linalg.norm(residual)
    slopes = np.abs(jacobian.T @ residual)[free & (sizes > 0)] / sizes[free & (sizes > 0)]
    exact = bool(np.linalg.norm(residual) <= rounding)
    agreed = int(np.sum(costs <= min(costs) * (1 + 1e-3) + rounding**2))
    return ProfileOptimum(x, residual, jacobian, float(slopes.max(initial=0.0)), exact, agreed, at_bound, rounding)


def _absorbing(compiled: Program, x: np.ndarray, residual: np.ndarray, args: tuple) -> np.ndarray:
    """Derivative of the residuals (n,) by σa itself where it is 0: that by its root vanishes there."""
    step = 1e-2 / float(args[-1].r.max()) / np.sqrt(3 * np.exp(x[1]))
    return (np.asarray(compiled.linearised(np.array([step, x[1]]), args)[0]) - residual) / (step + NEAR_ZERO) ** 2


def _polished(
    compiled: Program, x: np.ndarray, free: np.ndarray, args: tuple
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(x, residuals, Jacobian) after Gauss–Newton steps of what is free, as long as they lessen the cost."""
    residual, jacobian = (np.asarray(a) for a in compiled.linearised(x, args))
    share = 1.0
    for _ in range(POLISH):
        trial = x.copy()
        trial[free] -= share * np.linalg.lstsq(jacobian[:, free], residual, rcond=1e-12)[0]
        r, j = (np.asarray(a) for a in compiled.linearised(trial, args))
        if r @ r < residual @ residual:
            x, residual, jacobian = trial, r, j
        elif share > LEAST_SHARE:
            share /= 2  # far from the readings the steps are too long, from one side of the optimum to the other
        else:
            break
    return x, residual, jacobian


def _grid(data: ProfileData, start: np.ndarray) -> np.ndarray:
    """Starts (LENGTHS × albedos + 1, 2) over the lengths that the readings can tell; the last is `start`."""
    far = float(data.r[data.which[data.weight > 0]].max())
    near = max(float(np.median(data.r[np.argmin(data.r.max(axis=1))])), 1e-4 * far)
    extinction = 1 / np.geomspace(near / 10, far, LENGTHS)[:, None]
    albedo = np.array(ALBEDOS)
    points = np.stack(
        [
            np.sqrt(np.minimum(extinction * (1 - albedo), MOST)),
            np.log(np.minimum(extinction * albedo, MOST)),
        ],
        axis=-1,
    ).reshape(-1, 2)
    return np.vstack([points, np.where(np.isnan(start), points[len(points) // 2], start)])
