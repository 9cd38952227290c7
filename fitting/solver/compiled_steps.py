"""Steps of several descents side by side by one compiled loop, whose elements are the descents.

For up to 16 numbers, on the processor, in double precision: what `StepsByXLA` computes, from JAX's own trace of it,
many times as fast. What it does not take is XLA's.
"""

import dataclasses
import functools
import itertools
import threading
from collections.abc import Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from gonio.fitting.problem.arrow import UNROLLED, WHOLE, Arrow, Sizes
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import LINEAR, Domains, Mapped, span, to_parameters
from gonio.fitting.problem.readings import LANES, AnyArray
from gonio.fitting.solver.lm_step import Lane, Normal, evaluated, step
from gonio.fitting.solver.xla_steps import Descents, Points, Report, StepsByXLA, compile_step, padded_sizes
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import Rows, SumsProgram
from gonio.models.fingerprint import program_name

SIZES = (8, 12, 16)
"""Numbers of the descents that there are loops for; those beyond a problem's own act on nothing."""
KNOWN = 4
"""Of an evaluation: cost, stationarity, whether it is exact, what a Newton step promises."""
NOTHING = np.zeros(0)
LOCK = threading.Lock()


@dataclasses.dataclass(frozen=True, eq=False)
class Layout:
    """Where the numbers of a descent stand, of so many parameters.

    A row has the numbers of its `Lane`, then of an evaluation, then of the next point: parameters, and first and second
    derivatives by the coordinates. What is given has cost, gradient, matrix, then kinds, low and high ends of the
    domains, which are linear, and low ends and widths in even coordinates.
    """

    size: int
    kinds: list[np.ndarray]
    tree: Any

    @functools.cached_property
    def edges(self) -> list[int]:
        """Where the parts of a lane begin, and where the last ends."""
        return list(itertools.accumulate((a.size for a in self.kinds), initial=0))

    @functools.cached_property
    def lane(self) -> int:
        """Numbers of a lane."""
        return self.edges[-1]

    @functools.cached_property
    def row(self) -> int:
        """Numbers of a row."""
        return self.lane + KNOWN + 3 * self.size

    @functools.cached_property
    def equations(self) -> int:
        """Numbers of normal equations."""
        return 1 + self.size + self.size**2

    @functools.cached_property
    def given(self) -> int:
        """Numbers of what is given."""
        return self.equations + 6 * self.size

    @functools.cached_property
    def evaluation(self) -> slice:
        """Where in a row the numbers of an evaluation stand."""
        return slice(self.lane, self.lane + KNOWN)

    @functools.cached_property
    def flags(self) -> np.ndarray:
        """Where in a row it stands whether a descent accepted its trial, has finished, was refused, is near its end."""
        lane = self.places()
        return np.concatenate([lane.accepted, lane.finished, lane.refused, lane.near])

    def lane_of(self, numbers: Any) -> Lane:
        """Descents of their numbers (..., K); truth is a number above 0."""
        parts = [numbers[..., a:b] for a, b in itertools.pairwise(self.edges)]
        leaves = [part.reshape(*part.shape[:-1], *a.shape) for part, a in zip(parts, self.kinds, strict=True)]
        leaves = [v > 0 if a.dtype == bool else v for v, a in zip(leaves, self.kinds, strict=True)]
        return jax.tree.unflatten(self.tree, leaves)

    def places(self) -> Lane:
        """Where in a row each part of a lane stands."""
        return jax.tree.unflatten(self.tree, [np.arange(a, b) for a, b in itertools.pairwise(self.edges)])


@functools.cache
def layout_of(size: int) -> Layout:
    """The layout of descents of so many numbers."""
    no, none, zeros = np.zeros((), bool), np.zeros(()), np.zeros(size)
    normal = Normal(none, zeros, Arrow.dense(np.zeros((size, size))), none, no, none, zeros, none)
    kinds, tree = jax.tree.flatten(Lane(no, no, no, zeros, zeros, normal, zeros, none, none, no, no, no))
    return Layout(size, kinds, tree)


def steps_of(descents: Descents, sizes: Sizes) -> "StepsByLoop | StepsByXLA":
    """The steps of descents whose numbers have these sizes."""
    program = _program_of(sizes)
    return StepsByXLA(descents, sizes) if program is None else StepsByLoop(program, descents, sizes)


def compile_steps(sizes: Sizes) -> None:
    """Compile what takes the steps of descents of numbers of these sizes, before there are any."""
    if _program_of(sizes) is None:
        compile_step(padded_sizes(sizes))


def _program_of(sizes: Sizes) -> SumsProgram | None:
    size = next((size for size in SIZES if size >= sizes.total), None)
    if size is None or (sizes.per_channel and sizes.total > WHOLE) or not usable():
        return None
    with LOCK:
        return _program(size)


@functools.cache
def _program(size: int) -> SumsProgram | None:
    of, name = layout_of(size), program_name("steps", size)
    steps = (of.row,) * (of.lane + 3 * size) + (of.given,) * of.given
    unrolled = UNROLLED.set(size)
    try:
        return SumsProgram(Rows(functools.partial(_rows, of), [], 2, steps, name=name), [], range(of.row))
    except Unsupported:
        return None
    finally:
        UNROLLED.reset(unrolled)


def _rows(of: Layout, _: Sequence[Any], target_norm_squared: Array, rough: Array, *elements: Array) -> Array:
    """One descent a step on: its row, from the row before, and what is given."""
    numbers, size = jnp.stack(elements), of.size
    lane, given = of.lane_of(numbers[: of.lane]), cast(Any, numbers[of.lane + 3 * size :])
    mapped = Mapped(*numbers[of.lane : of.lane + 3 * size].reshape(3, size))
    matrix = given[1 + size : of.equations].reshape(size, size)
    equations = NormalEquations(given[0], given[1 : 1 + size], _symmetric(matrix))
    lane = lane._replace(normal=lane.normal._replace(hessian=_symmetric(lane.normal.hessian.corner)))
    kind, low, high, linear, *known = given[of.equations :].reshape(6, size)
    d = Domains(kind, low, high)
    latest = evaluated(d, mapped, equations, target_norm_squared, linear > 0)
    after = step(lane, latest, target_norm_squared, rough)
    what = (latest.cost, latest.stationarity, latest.exact, latest.promised)
    parts = [*jax.tree.leaves(after), *what, *to_parameters(d, after.trial, jnp, tuple(known))]
    return jnp.concatenate([jnp.ravel(a).astype(float) for a in parts if a.size])


def _fill(matrix: np.ndarray, arrow: Arrow) -> None:
    """Writes the upper half of arrows into matrices (S, SIZE, SIZE)."""
    shared, channels, each = arrow.sizes
    matrix[:, :shared, :shared] = arrow.corner
    for c in range(channels if each else 0):
        these = slice(shared + c * each, shared + (c + 1) * each)
        matrix[:, :shared, these], matrix[:, these, these] = arrow.border[:, c], arrow.blocks[:, c]


def _symmetric(matrix: AnyArray) -> Arrow:
    """A matrix whose lower half is not looked at: it is the same numbers."""
    return Arrow.dense(jnp.where(np.tri(len(matrix), k=-1, dtype=bool), matrix.T, matrix))


class StepsByLoop:
    """The steps of some descents."""

    def __init__(self, program: SumsProgram, descents: Descents, sizes: Sizes) -> None:
        """Of the program, and descents whose numbers have these sizes."""
        (number, size), lanes = descents.start.shape, program.rows.lanes
        of = self.layout = layout_of(next(s for s in SIZES if s >= size))
        self.program, self.descents, self.sizes, self.number, self.size = program, descents, sizes, number, size
        self.count = -(-number // lanes) * lanes
        rows = max(LANES, lanes)
        self.numbers, self.after = np.zeros((2, rows, of.row))
        self.given = np.zeros((rows, of.given))
        self.matrix = self.given[:, 1 + of.size : of.equations].reshape(rows, of.size, of.size)
        self._begin()
        self.p = self.numbers[:number, of.lane + KNOWN : of.lane + KNOWN + size].copy()
        self.scalars = np.array([descents.target_norm_squared, descents.rough])
        numbers = self.numbers.ctypes.data + 8 * np.arange(of.row)
        numbers = np.delete(numbers, np.arange(of.lane, of.lane + KNOWN))
        others = [a.ctypes.data + 8 * np.arange(n) for a, n in ((self.given, of.given), (self.after, 1))]
        scalars = self.scalars.ctypes.data + 8 * np.arange(2)
        self.addresses = np.concatenate([scalars, numbers, *others]).astype(np.uintp)[None]
        self.otherwise: StepsByXLA | None = None

    def _begin(self) -> None:
        """Fills in the descents before their first evaluation, and their domains."""
        of, d, number, size = self.layout, self.descents, self.number, self.size
        places, lane = of.places(), of.lane_of(self.numbers[:, : of.lane])
        lane.y[:number, :size] = lane.trial[:number, :size] = d.start
        self.numbers[:, places.first], self.numbers[:, places.shrinks] = 1.0, 1.0
        self.numbers[:, places.step_size] = d.step_size
        points = self.numbers[:, of.lane + KNOWN :].reshape(-1, 3, of.size)
        known = span(d.domains, np)
        for k, part in enumerate(to_parameters(d.domains, d.start, np, known)):
            points[:number, k, :size] = part
        domains = self.given[:, of.equations :].reshape(-1, 6, of.size)
        domains[:] = np.array([LINEAR, 0.0, 1.0, 0.0, 0.0, 1.0])[:, None]
        for k, part in enumerate((*d.domains, d.linear, *known)):
            domains[:number, k, :size] = part

    def __call__(self, equations: NormalEquations, active: np.ndarray) -> Report:
        """A step of the active descents (S,), from what was evaluated at their points."""
        number, size, of = self.number, self.size, self.layout
        self.given[:number, 0], self.given[:number, 1 : 1 + size] = equations.cost, equations.gradient
        _fill(self.matrix[:number], equations.matrix)
        if self.otherwise is None and self.program(NOTHING, self.addresses, self.count) is None:
            self.otherwise = self._by_xla()
        if self.otherwise is not None:
            return self.otherwise(equations, active)
        after, now, evaluated_p = self.after[:number], self.numbers[:number], self.p
        cost, stationarity, exact, promised = after[:, of.evaluation].T.copy()
        np.copyto(now, after, where=active[:, None])
        first = of.lane + KNOWN
        self.p = now[:, first : first + size].copy()
        points = Points(evaluated_p, cost, stationarity, exact > 0, promised)
        return Report(points, self.p, *(now.take(of.flags, axis=1).T > 0))

    def _by_xla(self) -> StepsByXLA:
        """The same by XLA, from here on: for numbers of which the loop does not know that it is right."""
        steps, sizes = StepsByXLA(self.descents, self.sizes), padded_sizes(self.sizes)
        size, more = self.layout.size, sizes.total - self.layout.size

        def padded(a: np.ndarray) -> np.ndarray:
            return np.pad(a, [(0, 0), *((0, more) if n == size else (0, 0) for n in a.shape[1:])])

        steps.lanes = jax.tree.map(padded, self.layout.lane_of(self.numbers[:LANES, : self.layout.lane].copy()))
        if sizes.total > size:
            hessian = Arrow.dense(np.asarray(steps.lanes.normal.hessian.corner))
            steps.lanes = steps.lanes._replace(normal=steps.lanes.normal._replace(hessian=hessian))
        steps.trial = steps.lanes.trial[: self.number, : self.size]
        return steps
