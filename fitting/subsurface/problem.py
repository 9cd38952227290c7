"""The least-squares problem of one channel of a profile: σa and σs' of a model that spots of finite size read."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.subsurface.base import MOST, AbstractBSSRDF

STARTS = 6
"""Descents, from the best points of a grid of mean free paths and albedos: half of them from its valleys."""
ALBEDOS = (0.2, 0.6, 0.9, 0.98, 0.996, 0.9993)
LENGTHS = 20
SHORTEST = 1 / 30
"""Mean free path of the grid over the distance of the nearest reading."""
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
    others: np.ndarray
    """Ends (STARTS, 2) of all descents."""

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


@dataclasses.dataclass(frozen=True)
class LeastSquares:
    """One channel's problem: its compiled functions and their data, what x (2,) stays at, and what of it is free."""

    compiled: Program
    fixed: np.ndarray
    free: np.ndarray
    eta: float
    data: ProfileData

    @classmethod
    def of(
        cls, kind: type[AbstractBSSRDF], data: ProfileData, eta: float, start: np.ndarray, free: np.ndarray
    ) -> "LeastSquares":
        """That of a model; `start` as of `solve`."""
        return cls(program(kind), np.where(np.isnan(start), 0.0, start), free, eta, data)

    @property
    def args(self) -> tuple:
        """What the compiled functions take beside x."""
        return self.fixed, self.free, np.asarray(self.eta), self.data

    def linearised(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals (n,) at x (2,), and their Jacobian (n, 2)."""
        with jax.enable_x64(True):
            residual, jacobian = self.compiled.linearised(x, self.args)
        return np.asarray(residual), np.asarray(jacobian)

    def cost(self, x: np.ndarray) -> float:
        """Σ r² at x (2,)."""
        residual, _ = self.linearised(x)
        return float(residual @ residual)


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


def solve(problem: LeastSquares, start: np.ndarray) -> ProfileOptimum:
    """The optimum of one channel, in double precision whatever the caller computes in: single leaves no sure optimum.

    Args:
        problem: the model, readings, weights and spots.
        start: x (2,) to begin at too, and where what is not free stays; NaN where nothing is known.
    """
    with jax.enable_x64(True):
        return _solved(problem, start)


def _solved(problem: LeastSquares, start: np.ndarray) -> ProfileOptimum:
    compiled, args, data, free = problem.compiled, problem.args, problem.data, problem.free
    rounding = EXACT * float(np.linalg.norm(data.y * data.weight))
    grid = _grid(data, start)
    costs = np.nan_to_num(np.asarray(compiled.costs(grid, args)), nan=np.inf)
    ends = np.asarray(compiled.descend(grid[_chosen(costs)], args))
    costs = np.asarray(compiled.costs(np.resize(ends, grid.shape), args))[:STARTS]  # one shape, one program
    costs = np.nan_to_num(costs, nan=np.inf)
    x, residual, jacobian = polished(problem, np.where(free, ends[np.argmin(costs)], problem.fixed), free)
    at_bound = False
    if free[0]:
        # Without absorption: x and −x are one material, so that the cost has a kink there and no slope of 0
        only = free & np.array([False, True])
        clear = dataclasses.replace(problem, fixed=np.zeros(2))
        bound = polished(clear, np.array([0.0, x[1]]), only)
        lower = bound[1] @ bound[1] <= residual @ residual - rounding**2
        at_bound = bool(lower or x[0] ** 2 <= NEGLIGIBLE * np.exp(x[1]))
        if at_bound:
            x, residual, jacobian, free = bound[0], bound[1], bound[2].copy(), only
            jacobian[:, 0] = _absorbing(problem, x, residual)
    sizes = np.linalg.norm(jacobian, axis=0) * np.linalg.norm(residual)
    slopes = np.abs(jacobian.T @ residual)[free & (sizes > 0)] / sizes[free & (sizes > 0)]
    exact = bool(np.linalg.norm(residual) <= rounding)
    agreed = int(np.sum(costs <= min(costs) * (1 + 1e-3) + rounding**2))
    gradient = float(slopes.max(initial=0.0))
    return ProfileOptimum(x, residual, jacobian, gradient, exact, agreed, at_bound, rounding, ends)


def _chosen(costs: np.ndarray) -> np.ndarray:
    """Numbers (STARTS,) of the grid's points to begin at: its lowest valleys, then what else is lowest."""
    field = np.pad(costs[:-1].reshape(-1, len(ALBEDOS)), 1, constant_values=np.inf)
    middle = field[1:-1, 1:-1]
    around = np.minimum.reduce([field[:-2, 1:-1], field[2:, 1:-1], field[1:-1, :-2], field[1:-1, 2:]])
    order = np.argsort(costs, kind="stable")
    valleys = [k for k in order if k < middle.size and (middle <= around).ravel()[k]][: STARTS // 2]
    return np.array([*valleys, *(k for k in order if k not in valleys)])[:STARTS]


def _absorbing(problem: LeastSquares, x: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Derivative of the residuals (n,) by σa itself where it is 0: that by its root vanishes there."""
    step = 1e-2 / float(problem.data.r.max()) / np.sqrt(3 * np.exp(x[1]))
    return (problem.linearised(np.array([step, x[1]]))[0] - residual) / (step + NEAR_ZERO) ** 2


def polished(
    problem: LeastSquares, x: np.ndarray, free: np.ndarray, enough: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(x, residuals, Jacobian) after Gauss–Newton steps of what is free, as long as they lessen the cost.

    By more than `enough`, that is.
    """
    residual, jacobian = problem.linearised(x)
    share = 1.0
    for _ in range(POLISH if free.any() else 0):
        trial = x.copy()
        trial[free] -= share * np.linalg.lstsq(jacobian[:, free], residual, rcond=1e-12)[0]
        r, j = problem.linearised(trial)
        lessened = residual @ residual - r @ r
        if lessened > 0:
            x, residual, jacobian = trial, r, j
            if lessened < enough:
                break
        elif share > LEAST_SHARE:
            share /= 2  # far from the readings the steps are too long, from one side of the optimum to the other
        else:
            break
    return x, residual, jacobian


def _grid(data: ProfileData, start: np.ndarray) -> np.ndarray:
    """Starts (LENGTHS × albedos + 1, 2) over the lengths that the readings can tell; the last is `start`."""
    far = float(data.r[data.which[data.weight > 0]].max())
    near = max(float(np.median(data.r[np.argmin(data.r.max(axis=1))])), 1e-4 * far)
    extinction = 1 / np.geomspace(SHORTEST * near, far, LENGTHS)[:, None]
    albedo = np.array(ALBEDOS)
    points = np.stack(
        [
            np.sqrt(np.minimum(extinction * (1 - albedo), MOST)),
            np.log(np.minimum(extinction * albedo, MOST)),
        ],
        axis=-1,
    ).reshape(-1, 2)
    return np.vstack([points, np.where(np.isnan(start), points[len(points) // 2], start)])
