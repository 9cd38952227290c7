"""Normal equations of averages over discs, by compiled loops: lobes at the nodes added up, then sums over readings."""

import functools
from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.problem.channel_parts import channel_parts
from gonio.fitting.problem.compiled_sums import (
    LAST,
    LOCK,
    NOTHING,
    Sums,
    kept,
    pairs_of_rows,
    rows_of_lobes,
    squares_of_pairs,
)
from gonio.fitting.problem.disc_averages import disc_rules
from gonio.fitting.problem.lobes import Lobes, lobes_at_sample
from gonio.fitting.problem.parameterisation import FixedValues, Parameterisation
from gonio.fitting.problem.readings import AnyArray
from gonio.models.compiled import workers
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import AddingProgram, Rows, SumsProgram
from gonio.models.expression.builder import prepared
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.models.geometry.horizon import turned_over
from gonio.models.warps.disc_frames import disc_frame, disc_ray, psi_of_horizon

NODE = 5
"""Numbers of a node in a disc: its column's x (or ψ over where it ends), √(1 − x²), weight; its row's y, weight."""
CHUNK = 512
"""Readings whose averages are formed at a time: they stay in a core's cache. A multiple of a vector's numbers."""


class AveragedReadings(NamedTuple):
    """Readings of a problem, to be compared with averages.

    Attributes:
        wi, wo: axes of the discs of light and detector, components (n,).
        target, weight: of the residuals, (n, C).
        rules: number of the rule of each (n,), see `disc_averages`.
        half_angles: of both discs, radians.
    """

    wi: Direction
    wo: Direction
    target: np.ndarray
    weight: np.ndarray
    rules: np.ndarray
    half_angles: tuple[float, float]


class _Programs:
    """The programs of one model and loss."""

    def __init__(self, whole: Parameterisation, loss: str, leaves: Sequence[np.ndarray], tree: Any) -> None:
        self.parts = channel_parts(whole)
        s, leaves = self.parts.parameterisation, self.parts.leaves(leaves, 0)
        self._s, self._leaves, self._tree, self.size, self.channels = s, leaves, tree, 1 + len(s.free), s.channels
        up = Direction(*NORMAL)
        fixed = jax.tree.unflatten(tree, leaves)[0]
        self._shapes = jax.eval_shape(lambda p: lobes_at_sample(s, p, fixed, up, up), np.zeros(s.size))
        self.lobes = sum(int(np.prod(a.shape)) for a in self._shapes)
        # Where no shape differs between channels, lobes are those of all parts.
        self.averaged_parts = len(self.parts.channels) if self._shapes.values.shape[1] > 1 else 1

        def rows(leaves: Sequence[Any], *elements: Array) -> Array:
            p = jnp.stack(elements[: s.size]) if s.size else jnp.zeros(0)
            fixed, floor, _ = jax.tree.unflatten(tree, leaves)
            cosine, total, *rest = elements[s.size :]
            split = int(np.prod(self._shapes.values.shape))
            scaled = jnp.stack(rest[: self.lobes]) / jnp.where(total > 0, total, 1.0)
            lobes = Lobes(
                scaled[:split].reshape(self._shapes.values.shape), scaled[split:].reshape(self._shapes.slopes.shape)
            )
            return rows_of_lobes(s, loss, p, (fixed, floor), lobes, (cosine, rest[self.lobes :]))

        self.rows = Rows(rows, leaves, s.size, (1,) * (2 + self.lobes) + (whole.channels,) * (2 * s.channels))
        self.averages, self.sums = functools.cache(self._averages), functools.cache(self._sums)

    def _averages(self, cut: tuple[bool, bool]) -> AddingProgram:
        """Of lobes times weights over nodes, of discs that the horizon cuts or does not."""

        def rows(leaves: Sequence[Any], *elements: Array) -> Array:
            p = jnp.stack(elements[: self._s.size]) if self._s.size else jnp.zeros(0)
            fixed, _, tan_s = jax.tree.unflatten(self._tree, leaves)
            nodes, axes = elements[self._s.size :][: 2 * NODE], elements[self._s.size :][2 * NODE :]
            wi, share_i = _ray(Direction(*axes[:3]), tan_s[0], nodes[:NODE], cut[0])
            wo, share_o = _ray(Direction(*axes[3:]), tan_s[1], nodes[NODE:], cut[1])
            lobes, weight = lobes_at_sample(self._s, p, fixed, wi, wo), share_i * share_o
            return jnp.concatenate([weight[None], *(weight * a.reshape(-1) for a in lobes)])

        apart = any(map(prepared, self._s.frames))
        with LOCK:
            return AddingProgram(Rows(rows, self._leaves, self._s.size, (1,) * 6, 2 * NODE, prepared=apart))

    def _sums(self, full: bool) -> SumsProgram:
        """Of products of rows; `full` with those times residuals, and f."""
        number = self.channels * self.size
        pairs = pairs_of_rows(self.channels, self.size, 0)
        with LOCK:
            if not full:
                return SumsProgram(self.rows, pairs)
            more = pairs_of_rows(self.channels, self.size, number)
            return SumsProgram(self.rows, [*pairs, *more], range(2 * number, 2 * number + self.channels))


def _ray(axis: Direction, tan_s: Array, node: Sequence[Array], cut: bool) -> tuple[Direction, Array]:
    """(direction, weight) of a node of a disc."""
    x, length, w, v, w_v = node
    side = jnp.where(axis.z < 0, -1.0, 1.0)
    frame = disc_frame(turned_over(axis, side), tan_s)
    if cut:
        psi_end = psi_of_horizon(frame)
        sine = jnp.sin(psi_end * x)
        x, y, w = jnp.cos(psi_end * x), sine * v, w * w_v * psi_end * sine * sine
    else:
        y, w = length * v, w * w_v
    ray, share = disc_ray(frame, tan_s * x, tan_s * y)
    return turned_over(ray, side), w * share


@functools.lru_cache(maxsize=64)
def _nodes(half_angles: tuple[float, float], rule: int) -> np.ndarray:
    """The numbers (2 · NODE, K) of the pairs of nodes of a rule."""
    rules, of_discs = disc_rules(half_angles), []
    for d in range(2):
        n, m = rules.shape[rule, d]
        columns, rows = np.asarray(rules.columns)[rule, d, :n], np.asarray(rules.rows)[rule, d, :m]
        of_discs.append(np.hstack([np.repeat(columns, m, axis=0), np.tile(rows, (n, 1))]))
    first, second = np.indices([len(a) for a in of_discs]).reshape(2, -1)
    return np.ascontiguousarray(np.hstack([of_discs[0][first], of_discs[1][second]]).T)


class _Piece(NamedTuple):
    """Readings of one rule, at most `CHUNK`, padded: where they stand, and their axes, targets and weights."""

    rule: int
    cells: np.ndarray
    axes: np.ndarray
    cosine: np.ndarray
    target: np.ndarray
    weight: np.ndarray


class BoundAverages:
    """The sums of one problem's readings."""

    def __init__(self, programs: _Programs, leaves: list[np.ndarray], readings: AveragedReadings) -> None:
        """Of the programs, the numbers that they do not take as free, and the readings."""
        self._programs, self._readings = programs, readings
        of_parts = [programs.parts.leaves(leaves, m) for m in range(len(programs.parts.channels))]
        self._parameters = functools.cache(lambda rows, part: rows.parameters(of_parts[part], NOTHING))
        self._prepared = functools.lru_cache(LAST)(
            lambda rows, part, numbers: rows.parameters(of_parts[part], np.frombuffer(numbers))
        )
        self._pieces = [
            piece
            for rule in np.unique(readings.rules).tolist()
            for piece in _pieces(readings, rule, np.flatnonzero(readings.rules == rule))
        ]

    def __call__(self, p: Float[np.ndarray, "s p"], full: bool) -> Sums | None:
        """The sums at S vectors of free numbers, `full` with f of one of them; None where XLA has to compute them."""
        p, pieces = np.ascontiguousarray(p, float), self._pieces
        try:
            programs = [self._averages(piece.rule) for piece in pieces], self._programs.sums(full)
        except Unsupported:
            return None
        f = np.zeros(self._readings.weight.shape) if full else None
        sums: list[list[np.ndarray | None]] = [[None] * len(pieces) for _ in p]

        def work(first: int, last: int) -> int:
            for k in range(first, last):
                s, number = divmod(k, len(pieces))
                sums[s][number] = self._of_piece(pieces[number], (programs[0][number], programs[1]), p[s], f)
            return 0

        workers.share(work, len(p) * len(pieces), 1)
        if any(part is None for row in sums for part in row):
            return None
        parts = self._programs.parts
        total = np.array(sums, float).reshape(len(p), len(pieces), -1).sum(axis=1)
        squares = squares_of_pairs(total.reshape(-1, programs[1].products), 1 + full, self._programs.channels)
        return Sums(parts.joined_squares(squares.reshape(len(p), -1, *squares.shape[1:])), f)

    def _averages(self, rule: int) -> AddingProgram:
        counts = disc_rules(self._readings.half_angles).counts[rule]
        return self._programs.averages((bool(rule % 2 and counts[0] > 1), bool(rule % 2 and counts[1] > 1)))

    def _of_piece(
        self, piece: _Piece, programs: tuple[AddingProgram, SumsProgram], p: np.ndarray, f: np.ndarray | None
    ) -> np.ndarray | None:
        averages, total = programs
        nodes, parts = _nodes(self._readings.half_angles, piece.rule), self._programs.parts
        sums, values, lobes = [], np.zeros((len(parts.channels), len(piece.target), self._programs.channels)), None
        for m, numbers in enumerate(parts.numbers):
            free = p.ctypes.data + 8 * numbers
            if m < self._programs.averaged_parts:
                places = [_rows_of(nodes), _rows_of(piece.axes)]
                if averages.rows.prepared:
                    parameters = self._prepared(averages.rows, m, p[numbers].tobytes())
                else:
                    places, parameters = [free, *places], self._parameters(averages.rows, m)
                sizes = nodes.shape[1], len(piece.target)
                lobes = averages(parameters, np.concatenate(places).astype(np.uintp), sizes)
            if lobes is None:
                return None
            strided = [a.ctypes.data + 8 * parts.channels[m] for a in (piece.target, piece.weight)]
            places = [piece.cosine.ctypes.data], _rows_of(lobes), *strided, [values[m].ctypes.data] * (f is not None)
            addresses = np.concatenate([free, *places]).astype(np.uintp)
            sums.append(total(self._parameters(total.rows, m), addresses[None], len(piece.target)))
        if f is not None:
            f[piece.cells] = parts.joined_values(values)[: piece.cells.size]
        return None if any(a is None for a in sums) else np.concatenate(sums, axis=1)[0]


def _rows_of(a: np.ndarray) -> np.ndarray:
    """Where the rows of an array begin."""
    return a.ctypes.data + a.strides[0] * np.arange(len(a))


def _pieces(r: AveragedReadings, rule: int, cells: np.ndarray) -> list[_Piece]:
    """The readings of one rule in pieces: parts of arrays that are laid out once."""
    n, channels = cells.size, r.target.shape[1]
    size = n + -n % 16
    axes, target, weight = np.empty((6, size)), np.zeros((size, channels)), np.zeros((size, channels))
    for row, c, fill in zip(axes, (*r.wi, *r.wo), (*NORMAL, *NORMAL), strict=True):
        row[:n], row[n:] = np.asarray(c)[cells], fill
    target[:n], weight[:n] = r.target[cells], r.weight[cells]
    cosine, parts = np.abs(axes[2]), [slice(first, min(first + CHUNK, size)) for first in range(0, size, CHUNK)]
    return [_Piece(rule, cells[s], axes[:, s], cosine[s], target[s], weight[s]) for s in parts]


_kept: dict[Hashable, _Programs | None] = {}


def bound_averages(
    s: Parameterisation, loss: str, fixed: FixedValues, floor: AnyArray | float, readings: AveragedReadings
) -> BoundAverages | None:
    """The sums over readings that are averages; None where XLA has to compute them.

    Args:
        s: the model.
        loss: of its residuals.
        fixed: the model's numbers that are not free.
        floor: of the loss, in the units of what it compares.
        readings: their discs, rules, targets and weights.
    """
    if not usable():
        return None
    tan_s = np.asarray(disc_rules(readings.half_angles).tan_s)
    leaves, tree = jax.tree.flatten((fixed, np.asarray(floor, float), tan_s))
    leaves = [np.asarray(a) for a in leaves]
    key = (s, loss, tree, tuple((a.shape, a.dtype.str) for a in leaves))
    programs = kept(_kept, key, lambda: _Programs(s, loss, leaves, tree))
    return None if programs is None else BoundAverages(programs, leaves, readings)
