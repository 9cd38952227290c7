"""Steps of several descents side by side by one compiled loop, whose elements are the descents.

For up to 8 numbers, on the processor, in double precision: what `StepsByXLA` computes, from JAX's own trace of it, many
times as fast. What it does not take is XLA's.
"""

import functools
import itertools
import threading
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from gonio.fitting.problem.arrow import UNROLLED, Arrow, Sizes
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import LINEAR, Domains, to_parameters
from gonio.fitting.problem.readings import LANES
from gonio.fitting.solver.lm_step import Lane, Normal, evaluated, step
from gonio.fitting.solver.xla_steps import Descents, Points, Report, StepsByXLA, compile_step, padded_sizes
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import Rows, SumsProgram
from gonio.models.fingerprint import program_name

SIZE = UNROLLED
"""Numbers of each descent; those beyond a problem's own act on nothing."""
EQUATIONS = 1 + SIZE + SIZE * SIZE
"""Numbers of normal equations: cost, gradient, matrix."""
NOTHING = np.zeros(0)
LOCK = threading.Lock()


def steps_of(descents: Descents, sizes: Sizes) -> "StepsByLoop | StepsByXLA":
    """The steps of descents whose numbers have these sizes."""
    padded = padded_sizes(sizes)
    program = _program() if padded == (SIZE, 0, 0) and usable() else None
    return StepsByXLA(descents, sizes) if program is None else StepsByLoop(program, descents, sizes)


def compile_steps(sizes: Sizes) -> None:
    """Compile what takes the steps of descents of these padded sizes, before there are any."""
    if sizes != (SIZE, 0, 0) or not usable() or _program() is None:
        compile_step(sizes)


def _program() -> SumsProgram | None:
    with LOCK:
        return _compiled_program()


@functools.cache
def _compiled_program() -> SumsProgram | None:
    here, given = _length() + 4 + SIZE, EQUATIONS + 4 * SIZE
    name = program_name("steps", SIZE)
    try:
        rows = Rows(_rows, [], 2, (here,) * _length() + (given,) * given, name=name)
        return SumsProgram(rows, [], range(here))
    except Unsupported:
        return None


@functools.cache
def _kinds() -> tuple[list[np.ndarray], Any]:
    """Arrays as those of one descent, and how they make a `Lane`."""
    no, none, zeros = np.zeros((), bool), np.zeros(()), np.zeros(SIZE)
    normal = Normal(none, zeros, Arrow.dense(np.zeros((SIZE, SIZE))), none, no, none, zeros, none)
    return jax.tree.flatten(Lane(no, no, no, zeros, zeros, normal, zeros, none, none, no, no, no))


def _length() -> int:
    """Numbers of a descent."""
    return sum(a.size for a in _kinds()[0])


def _lane_of(numbers: Any) -> Lane:
    """Descents of their numbers (..., K); truth is a number above 0."""
    kinds, tree = _kinds()
    edges = np.cumsum([0, *(a.size for a in kinds)])
    parts = [numbers[..., a:b] for a, b in itertools.pairwise(edges)]
    leaves = [part.reshape(*part.shape[:-1], *a.shape) for part, a in zip(parts, kinds, strict=True)]
    leaves = [v > 0 if a.dtype == bool else v for v, a in zip(leaves, kinds, strict=True)]
    return jax.tree.unflatten(tree, leaves)


@functools.cache
def _places() -> Lane:
    """Where in the numbers of a descent each of its parts stands."""
    kinds, tree = _kinds()
    edges = np.cumsum([0, *(a.size for a in kinds)]).tolist()
    return jax.tree.unflatten(tree, [first + np.arange(a.size) for first, a in zip(edges, kinds, strict=False)])


def _rows(_: Sequence[Any], target_norm_squared: Array, rough: Array, *elements: Array) -> Array:
    """One descent a step on: its numbers, what was evaluated, and its next parameters, in one row."""
    numbers = jnp.stack(elements)
    state, given = numbers[: _length()], numbers[_length() :]
    matrix, lane = given[1 + SIZE : EQUATIONS].reshape(SIZE, SIZE), _lane_of(state)
    equations = NormalEquations(given[0], given[1 : 1 + SIZE], _symmetric(matrix))
    lane = lane._replace(normal=lane.normal._replace(hessian=_symmetric(lane.normal.hessian.corner)))
    kind, low, high, linear = given[EQUATIONS:].reshape(4, SIZE)
    d = Domains(kind, low, high)
    latest = evaluated(d, to_parameters(d, lane.trial), equations, target_norm_squared, linear > 0)
    after = step(lane, latest, target_norm_squared, rough)
    known = (latest.cost, latest.stationarity, latest.exact, latest.promised)
    parts = [*jax.tree.leaves(after), *known, to_parameters(d, after.trial).p]
    return jnp.concatenate([jnp.ravel(a).astype(float) for a in parts if a.size])


def _symmetric(matrix: Array) -> Arrow:
    """A matrix whose lower half is not looked at: it is the same numbers."""
    return Arrow.dense(jnp.where(np.tri(SIZE, k=-1, dtype=bool), matrix.T, matrix))


class StepsByLoop:
    """The steps of some descents."""

    def __init__(self, program: SumsProgram, descents: Descents, sizes: Sizes) -> None:
        """Of the program, and descents whose numbers have these sizes."""
        (number, size), length, lanes = descents.start.shape, _length(), program.rows.lanes
        self.program, self.descents, self.sizes, self.number, self.size = program, descents, sizes, number, size
        self.count = -(-number // lanes) * lanes
        rows = max(LANES, lanes)
        self.numbers, self.after = np.zeros((2, rows, length + 4 + SIZE))
        self.given = np.zeros((rows, EQUATIONS + 4 * SIZE))
        start, places = _lane_of(self.numbers[:, :length]), _places()
        start.y[:number, :size] = start.trial[:number, :size] = descents.start
        self.numbers[:, places.first], self.numbers[:, places.shrinks] = 1.0, 1.0
        self.numbers[:, places.step_size] = descents.step_size
        domains = self.given[:, EQUATIONS:].reshape(rows, 4, SIZE)
        domains[:] = np.array([LINEAR, 0.0, 1.0, 0.0])[:, None]
        for k, part in enumerate((*descents.domains, descents.linear)):
            domains[:number, k, :size] = part
        self.p = to_parameters(descents.domains, descents.start, np).p
        self.scalars = np.array([descents.target_norm_squared, descents.rough])
        places_of = [a.ctypes.data + 8 * np.arange(n) for a, n in (
            (self.scalars, 2), (self.numbers, length), (self.given, EQUATIONS + 4 * SIZE), (self.after, 1)
        )]  # fmt: skip
        self.addresses = np.concatenate(places_of).astype(np.uintp)[None]
        self.otherwise: StepsByXLA | None = None

    def __call__(self, equations: NormalEquations, active: np.ndarray) -> Report:
        """A step of the active descents (S,), from what was evaluated at their points."""
        number, size, length, places = self.number, self.size, _length(), _places()
        given = self.given[:number]
        given[:, 0], given[:, 1 : 1 + size] = equations.cost, equations.gradient
        given[:, 1 + SIZE : EQUATIONS].reshape(number, SIZE, SIZE)[:, :size, :size] = equations.matrix.corner
        if self.otherwise is None and self.program(NOTHING, self.addresses, self.count) is None:
            self.otherwise = self._by_xla()
        if self.otherwise is not None:
            return self.otherwise(equations, active)
        after, evaluated_p = self.after[:number], self.p
        cost, stationarity, exact, promised = after[:, length : length + 4].T.copy()
        self.numbers[:number][active] = after[active]
        now = self.numbers[:number]
        self.p = np.where(active[:, None], now[:, length + 4 : length + 4 + size], self.p)
        flags = (now[:, k[0]] > 0 for k in (places.accepted, places.finished, places.refused, places.near))
        return Report(Points(evaluated_p, cost, stationarity, exact > 0, promised), self.p, *flags)

    def _by_xla(self) -> StepsByXLA:
        """The same by XLA, from here on: for numbers of which the loop does not know that it is right."""
        steps = StepsByXLA(self.descents, self.sizes)
        steps.lanes = _lane_of(self.numbers[:LANES, : _length()].copy())
        steps.trial = steps.lanes.trial[: self.number, : self.size]
        return steps
