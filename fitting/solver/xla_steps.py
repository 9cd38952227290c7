"""Steps of several descents side by side by a program of XLA, for numbers of any sizes and either precision.

The program knows nothing of the model: it is compiled once for all models of up to 8 free numbers, and for powers of
two of channels.
"""

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gonio.fitting.problem.arrow import WHOLE, Arrow, Sizes
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains, to_parameters
from gonio.fitting.problem.readings import LANES, AnyArray
from gonio.fitting.solver.lm_step import Lane, Normal, evaluated, is_double, step
from gonio.models.kept_jit import kept_jit


class Points(NamedTuple):
    """What is known at the points of S descents.

    `promised`: what an undamped Newton step takes off the cost.
    """

    p: np.ndarray
    cost: np.ndarray
    stationarity: np.ndarray
    exact: np.ndarray
    promised: np.ndarray


class Report(NamedTuple):
    """What a step of S descents says: of the points that were evaluated, and where to look next (S, P)."""

    points: Points
    p: np.ndarray
    accepted: np.ndarray
    finished: np.ndarray
    refused: np.ndarray
    near: np.ndarray


class Descents(NamedTuple):
    """Several descents before their first evaluation, S of P numbers, all in the order of the arrow.

    `domains`, `linear`: of the numbers, (P,) or (S, P); `start`: unconstrained coordinates (S, P).
    """

    domains: Domains
    linear: np.ndarray
    start: np.ndarray
    step_size: float
    target_norm_squared: float
    rough: float


class StepsByXLA:
    """The steps of some descents."""

    def __init__(self, descents: Descents, sizes: Sizes) -> None:
        """Of descents whose numbers have these sizes."""
        self.descents, self.trial, self.sizes = descents, descents.start, padded_sizes(sizes)
        self.places = padded_places(sizes, self.sizes)
        start = np.zeros((LANES, self.sizes.total))
        start[: len(self.trial), self.places] = self.trial
        self.lanes = fresh(self.sizes, descents.step_size, is_double())._replace(trial=start, y=start)
        self.limits = np.asarray(descents.target_norm_squared), np.asarray(float(descents.rough))

    def __call__(self, equations: NormalEquations, active: np.ndarray) -> Report:
        """A step of the active descents (S,), from what was evaluated at their points."""
        d, number = self.descents, len(self.trial)
        if equations.matrix.sizes.channels and not self.sizes.channels:
            equations = equations._replace(matrix=Arrow.dense(equations.matrix.whole()))
        mapped = to_parameters(d.domains, self.trial, np)
        normal = evaluated(d.domains, mapped, equations, d.target_norm_squared, d.linear)
        every = np.zeros(LANES, bool)
        every[:number] = active
        self.lanes, report = advance(self.lanes, packed_up(normal, self.sizes), every, *self.limits)
        report = np.asarray(report)[:number]
        self.trial, flags = report[:, self.places], report[:, self.sizes.total :].T > 0
        known = map(np.asarray, (normal.stationarity, normal.exact, normal.promised))
        points = Points(mapped.p, equations.cost, *known)
        return Report(points, to_parameters(d.domains, self.trial, np).p, *flags)


@kept_jit
def advance(
    lanes: Lane,
    packed: Float[AnyArray, "s q"],
    active: Bool[AnyArray, " s"],
    target_norm_squared: Float[AnyArray, ""],
    rough: Float[AnyArray, ""],
) -> tuple[Lane, Float[AnyArray, "s r"]]:
    """(the lanes a step on; in one array their trial, accepted, finished, refused, near).

    What was evaluated comes in one array (see `packed_up`): each array by itself costs as long as a step.
    """
    size, shapes = lanes.y.shape[1], [a.shape for a in lanes.normal.hessian]
    lengths = [5, size, size, *(math.prod(shape[1:]) for shape in shapes)]
    numbers, gradient, projection, *hessian = jnp.split(packed, np.cumsum(lengths)[:-1], axis=1)
    cost, measure, exact, promised, gain = numbers.T
    hessian = Arrow(*(a.reshape(shape) for a, shape in zip(hessian, shapes, strict=True)))
    latest = Normal(cost, gradient, hessian, measure, exact > 0, promised, projection, gain)
    stepped = jax.vmap(step, (0, 0, None, None))(lanes, latest, target_norm_squared, rough)
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
def fresh(sizes: Sizes, step_size: float, double: bool) -> Lane:
    """`LANES` descents before their first evaluation, in the precision of now (`double`: a key of the cache)."""
    zeros, no, none = np.zeros((LANES, sizes.total)), np.zeros(LANES, bool), np.zeros(LANES)
    hessian = Arrow(*(np.zeros((LANES, *shape)) for shape in arrow_shapes(sizes)))
    normal = Normal(none, zeros, hessian, none, no, none, zeros, none)
    lane = Lane(~no, no, no, zeros, zeros, normal, zeros, none + 1.0, np.full(LANES, step_size), no, no, no)
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
