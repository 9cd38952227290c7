"""Normal equations by one compiled loop over the readings (`gonio.models.compiled.sums`), where XLA is not needed.

For models at points, on the processor, in double precision: what the program of XLA computes, several times as fast and
compiled in a tenth of the time. What it does not take is XLA's.
"""

import ctypes
import functools
import itertools
import math
import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.problem.channel_parts import ChannelParts, channel_parts
from gonio.fitting.problem.disc_averages import Samples
from gonio.fitting.problem.lobes import Lobes, lobes_at_sample, rows_of, strengths_of, sum_of_lobes
from gonio.fitting.problem.parameterisation import FixedValues, Parameterisation
from gonio.fitting.problem.readings import LANES, AnyArray, transform, uses_cosine
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import Rows, SumsProgram
from gonio.models.expression.builder import prepared
from gonio.models.fingerprint import program_name
from gonio.models.geometry.directions import Direction

KEPT = 128
"""Programs that a process remembers."""
SCRATCH = 1 << 16
"""Samples whose f is stored at a time where it is not kept."""
LOCK = threading.RLock()
LAST = 64
"""Vectors of numbers whose part of a formula without directions a process remembers."""
NOTHING = np.zeros(0)
"""Parameters of loops that take all numbers as what is the same for all elements."""


class Sums(NamedTuple):
    """What a problem's program gives: as `page_program`'s squares of each vector of free numbers, and f."""

    squares: Float[np.ndarray, "s two c g g"]
    f: Float[np.ndarray, "n c"] | None


class _Programs:
    """The programs of one model and loss: sums alone, and the score covariance and the model's f with them."""

    def __init__(self, whole: Parameterisation, loss: str, leaves: Sequence[np.ndarray], tree: Any) -> None:
        self.parts = channel_parts(whole)
        s = self.parts.parameterisation
        self.size, self.channels = 1 + len(s.free), s.channels
        shapes = shapes_of_part(self.parts, leaves)
        steps, known = (1,) * 6 + (whole.channels,) * (2 * s.channels), sum(math.prod(shape) for shape in shapes)

        def rows(_: Sequence[Any], *elements: Array) -> Array:
            p, rest, others = taken(s, tree, shapes, elements)
            return _rows(s, loss, p, rest, others)

        name = program_name("sums", s.frames, s.free, s.channels, whole.channels, loss, str(tree), shapes)
        self.rows = Rows(rows, [], s.size + known, steps, name=name, prepared=any(map(prepared, s.frames)))
        self.prepared = functools.lru_cache(LAST)(lambda row: self.rows.parameters([], np.frombuffer(row)))
        self.offsets = functools.lru_cache(2 * LANES)(self._offsets)
        self.plain  # noqa: B018  (where it is unsupported, all is)

    def _offsets(self, number: int, size: int) -> np.ndarray:
        """Bytes from the first of so many vectors of all free numbers to those of each vector and part."""
        return 8 * (np.arange(number)[:, None, None] * size + self.parts.numbers)

    @functools.cached_property
    def plain(self) -> SumsProgram:
        """Of the sums alone."""
        with LOCK:
            return SumsProgram(self.rows, pairs_of_rows(self.channels, self.size, 0))

    @functools.cached_property
    def full(self) -> SumsProgram:
        """With the products of rows times residuals, and the model's values."""
        number = self.channels * self.size
        with LOCK:
            pairs = [pair for first in (0, number) for pair in pairs_of_rows(self.channels, self.size, first)]
            return SumsProgram(self.rows, pairs, range(2 * number, 2 * number + self.channels))

    @functools.cached_property
    def values(self) -> SumsProgram:
        """Of the model's values alone."""
        first = 2 * self.channels * self.size
        with LOCK:
            return SumsProgram(self.rows, [], range(first, first + self.channels))


def shapes_of_part(parts: ChannelParts, leaves: Sequence[np.ndarray]) -> list[tuple[int, ...]]:
    """Shapes of the numbers that are not free, of one part of the channels."""
    channels = (parts.parameterisation.channels,)
    return [channels if a.shape == (parts.count,) else a.shape for a in leaves]


def taken(
    s: Parameterisation, tree: Any, shapes: Sequence[tuple[int, ...]], elements: Sequence[Array]
) -> tuple[Array, Any, list[Array]]:
    """(free numbers, those that are not free, the others) of the scalars that a formula takes one after another."""
    p = jnp.stack(elements[: s.size]) if s.size else jnp.zeros(0)
    numbers, rest = iter(elements[s.size :]), []
    for shape in shapes:
        of_leaf = [next(numbers) for _ in range(math.prod(shape))]
        rest.append(jnp.stack(of_leaf).reshape(shape) if shape else of_leaf[0])
    return p, jax.tree.unflatten(tree, rest), list(numbers)


def _rows(s: Parameterisation, loss: str, p: Array, rest: Sequence[Any], elements: Sequence[Array]) -> Array:
    wi, wo = Direction(*elements[:3]), Direction(*elements[3:6])
    lobes = lobes_at_sample(s, p, rest[0], wi, wo)
    return rows_of_lobes(s, loss, p, rest, lobes, (jnp.abs(wi.z), elements[6:]))


def rows_of_lobes(
    s: Parameterisation, loss: str, p: Array, rest: Sequence[Any], lobes: Lobes, reading: tuple[Array, Sequence[Array]]
) -> Array:
    """Residual and derivatives of each channel, these times the residual, and f of each channel, in one row.

    Args:
        s: the model.
        loss: of its residuals.
        p: free numbers.
        rest: fixed numbers, and the loss's floor.
        lobes: of the model, for one reading.
        reading: |cosθi|, and target and weight of each channel, one after another.
    """
    (fixed, floor), (cosine, compared), c = rest, reading, s.channels
    target, weight = jnp.stack(compared[:c]), jnp.stack(compared[c:])
    strengths, lobes = strengths_of(s, p, fixed), Lobes(*(a[..., None] for a in lobes))
    f = jnp.broadcast_to(sum_of_lobes(lobes, strengths)[:, 0], (c,))
    factor = cosine if uses_cosine(loss) else 1.0
    value, slope = transform(loss, f * factor, floor)
    used = weight > 0
    residual = jnp.where(used, weight * (value - target), 0.0)
    by_f = jnp.where(used, weight * slope * factor, 0.0)
    rows = jnp.stack([residual, *(row[:, 0] * by_f for row in rows_of(s, lobes, strengths))], axis=1)
    return jnp.concatenate([rows.reshape(-1), (rows * residual[:, None]).reshape(-1), f])


def pairs_of_rows(channels: int, size: int, first: int) -> list[tuple[int, int]]:
    """Pairs of the `size` rows of each channel, itself included, from row `first` on."""
    starts = [first + c * size for c in range(channels)]
    return [(a + i, a + j) for a in starts for i, j in itertools.combinations_with_replacement(range(size), 2)]


def squares_of_pairs(sums: np.ndarray, parts: int, channels: int) -> np.ndarray:
    """The sums (S, parts · C · pairs) of `pairs_of_rows` as `page_program` gives them: (S, 2, C, size, size)."""
    of_pairs = sums.reshape(len(sums), parts, channels, -1)
    size = (math.isqrt(8 * of_pairs.shape[-1] + 1) - 1) // 2
    squares = np.zeros((len(sums), 2, channels, size, size))
    i, j = _upper(size)
    squares[:, :parts, :, i, j] = squares[:, :parts, :, j, i] = of_pairs
    return squares


@functools.cache
def _upper(size: int) -> tuple[np.ndarray, np.ndarray]:
    return np.triu_indices(size)


_programs: dict[Hashable, _Programs | None] = {}


def _programs_of(
    s: Parameterisation, loss: str, fixed: FixedValues, floor: AnyArray
) -> tuple[list[np.ndarray], _Programs | None]:
    """The programs of a model and a loss, and what they take beside free numbers and samples."""
    leaves, tree = jax.tree.flatten((fixed, np.asarray(floor, float)))
    leaves = [np.ascontiguousarray(a, float) for a in leaves]
    key = (s, loss, tree, tuple(a.shape for a in leaves))
    return leaves, kept(_programs, key, lambda: _Programs(s, loss, leaves, tree))


def kept(programs: dict[Hashable, Any], key: Hashable, made: Callable[[], Any]) -> Any:
    """The programs of this key, made where there are none; None where they are unsupported. The oldest of many goes."""
    with LOCK:
        if key not in programs:
            while len(programs) >= KEPT:
                programs.pop(next(iter(programs)))
            try:
                programs[key] = made()
            except Unsupported:
                programs[key] = None
        return programs[key]


def compile_sums(s: Parameterisation, loss: str, fixed: FixedValues) -> bool:
    """Compile what a fit needs, before there are readings; whether it can be."""
    programs = _programs_of(s, loss, fixed, np.asarray(1.0))[1] if usable() else None
    try:
        return programs is not None and bool(programs.plain) and bool(programs.full)
    except Unsupported:
        return False


class BoundSums:
    """The sums of one problem's samples."""

    def __init__(self, programs: _Programs, leaves: Sequence[np.ndarray], samples: Samples, number: int) -> None:
        """Of the programs, the numbers that are not free, and samples, at points, so many in use."""
        self._programs, self._number, lanes = programs, number, programs.rows.lanes
        self._count = -(-number // lanes) * lanes  # the rest of the last block weighs nothing
        arrays = [np.asarray(a, float) for a in (*samples.wi, *samples.wo, samples.target, samples.weight)]
        channels, places = programs.parts.channels, [a.ctypes.data for a in arrays]
        known = map(programs.parts.addresses, leaves)
        directions = np.broadcast_to(places[:6], (len(channels), 6))
        self._places = np.hstack([*known, directions, *(place + 8 * channels for place in places[6:])])
        compared = 2 * channels.shape[1]
        self._steps = np.repeat(
            [0, 8, 8 * samples.weight.shape[-1]], [self._places.shape[1] - 6 - compared, 6, compared]
        )
        self._kept = (leaves, arrays)

    def pairs(self, p: Float[np.ndarray, "s p"]) -> Float[np.ndarray, "s c pairs"] | None:
        """Each product of two rows once, at S vectors of free numbers, where one part has all channels; else None."""
        programs = self._programs
        if len(programs.parts.channels) > 1:
            return None
        sums, _ = self._run(programs.plain, p, False)
        return None if sums is None else sums.reshape(len(p), programs.channels, -1)

    def __call__(self, p: Float[np.ndarray, "s p"], full: bool) -> Sums | None:
        """The sums at S vectors of free numbers, `full` with f of one of them; None where XLA has to compute them."""
        programs = self._programs
        try:
            program = programs.full if full else programs.plain
        except Unsupported:
            return None
        sums, f = self._run(program, p, full)
        if sums is None:
            return None
        squares = squares_of_pairs(sums, 1 + full, programs.channels)
        squares = programs.parts.joined_squares(squares.reshape(len(p), -1, *squares.shape[1:]))
        return Sums(squares, programs.parts.joined_values(f) if full else None)

    def scored(self, p: Float[np.ndarray, "1 p"]) -> Float[np.ndarray, "1 two c g g"] | None:
        """The sums at a vector of free numbers, with those of the score covariance, without f of all samples."""
        programs, total = self._programs, 0.0
        for first in range(0, self._count, SCRATCH):
            try:
                sums, _ = self._run(programs.full, p, True, (first, min(SCRATCH, self._count - first)))
            except Unsupported:
                return None
            if sums is None:
                return None
            total = total + sums
        squares = squares_of_pairs(np.asarray(total), 2, programs.channels)
        return programs.parts.joined_squares(squares.reshape(1, -1, *squares.shape[1:]))

    def values(self, p: Float[np.ndarray, " p"]) -> Float[np.ndarray, "n c"] | None:
        """f of the samples at a vector of free numbers; None where XLA has to compute it."""
        try:
            sums, f = self._run(self._programs.values, p[None], True)
        except Unsupported:
            return None
        return None if sums is None else self._programs.parts.joined_values(f)

    def _run(
        self, program: SumsProgram, p: np.ndarray, stores: bool, samples: tuple[int, int] | None = None
    ) -> tuple[np.ndarray | None, np.ndarray]:
        """What a program sums at each vector and part, and f of each part (M, n, K) if it `stores` that.

        `samples`: the first one, and how many; by default all.
        """
        programs, (parts, numbers) = self._programs, self._programs.parts.numbers.shape
        first, count = samples or (0, self._count)
        p = np.ascontiguousarray(p, float)
        f = np.empty((parts, count if stores else 0, programs.channels))
        addresses = np.empty((len(p), parts, numbers + self._places.shape[1] + stores), np.uintp)
        addresses[:, :, :numbers] = programs.offsets(*p.shape) + p.ctypes.data
        places = self._places + first * self._steps if first else self._places
        addresses[:, :, numbers : numbers + self._places.shape[1]] = places
        if stores:
            addresses[:, :, -1] = f.ctypes.data + f.strides[0] * np.arange(parts)
        addresses, parameters = addresses.reshape(len(p) * parts, -1), NOTHING
        if before := programs.rows.prepared:
            scalars = [[ctypes.c_double.from_address(a).value for a in row] for row in addresses[:, :before].tolist()]
            parameters = np.stack([programs.prepared(np.array(row).tobytes()) for row in scalars])
            addresses = np.ascontiguousarray(addresses[:, before:])
        sums = program(parameters, addresses, count)
        return sums, f[:, : self._number]


def sums_of_samples(
    s: Parameterisation, loss: str, fixed: FixedValues, floor: AnyArray
) -> Callable[[Samples, int], BoundSums] | None:
    """What makes the sums over samples, at points, so many in use; None where XLA has to compute them."""
    if not usable():
        return None
    leaves, programs = _programs_of(s, loss, fixed, floor)
    return None if programs is None else functools.partial(BoundSums, programs, leaves)


def bound_sums(s: Parameterisation, loss: str, fixed: FixedValues, samples: Samples, number: int) -> BoundSums | None:
    """The sums over a problem's samples, at points, so many in use; None where XLA has to compute them."""
    make = sums_of_samples(s, loss, fixed, samples.floor)
    return None if make is None else make(samples, number)
