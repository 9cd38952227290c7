"""Normal equations of averages over discs, by compiled loops: lobes at the nodes added up, then sums over readings."""

import copy
import functools
import json
import math
from collections.abc import Callable, Hashable, Sequence
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
    shapes_of_part,
    squares_of_pairs,
    taken,
)
from gonio.fitting.problem.disc_averages import CUT, KINDS, OPPOSED, disc_rules
from gonio.fitting.problem.lobes import Lobes, lobes_at_sample
from gonio.fitting.problem.parameterisation import FixedValues, Parameterisation
from gonio.fitting.problem.readings import AnyArray
from gonio.models.compiled import kept as files
from gonio.models.compiled import workers
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import AddingProgram, Rows, SumsProgram
from gonio.models.expression.builder import prepared
from gonio.models.fingerprint import program_name
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.models.geometry.horizon import turned_over
from gonio.models.warps.disc_frames import disc_frame, disc_ray, pair_normal, psi_of_horizon, ray_about

NODE = 5
"""Numbers of a node in a disc: its column's x (or ψ over where it ends), √(1 − x²), weight; its row's y, weight. Of a
pair of nodes of `pair_rules` there are as many."""
LANES = 8
"""What readings of a rule are filled up to a multiple of: numbers of the widest vector."""
LEAST, MOST, WORK = 512, 2048, 1 << 18
"""Readings whose averages are formed at a time, a multiple of a vector's numbers: they stay in a core's cache; and
readings times pairs of nodes, of more than the least."""
ALONE = 1 << 15
"""The same, up to which all of it is done before another thread wakes."""
MOST_KEPT = 1 << 22
"""Numbers of averages that are kept for problems of other targets."""


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
        s, shapes = self.parts.parameterisation, shapes_of_part(self.parts, leaves)
        self._s, self._tree, self.size, self.channels = s, tree, 1 + len(s.free), s.channels
        self._fixed, self._scalars = shapes, s.size + sum(math.prod(shape) for shape in shapes)
        self._of = s.frames, s.free, s.channels, whole.channels, str(tree), shapes
        self._shapes = self._kept_shapes()
        values, slopes = self._shapes
        self.lobes = math.prod(values) + math.prod(slopes)
        # Where no shape differs between channels, lobes are those of all parts.
        self.averaged_parts = len(self.parts.channels) if values[1] > 1 else 1

        def rows(_: Sequence[Any], *elements: Array) -> Array:
            p, (fixed, floor, _), others = taken(s, tree, shapes, elements)
            cosine, total, *rest = others
            split = math.prod(values)
            scaled = jnp.stack(rest[: self.lobes]) / jnp.where(total > 0, total, 1.0)
            lobes = Lobes(scaled[:split].reshape(values), scaled[split:].reshape(slopes))
            return rows_of_lobes(s, loss, p, (fixed, floor), lobes, (cosine, rest[self.lobes :]))

        steps = (1,) * (2 + self.lobes) + (whole.channels,) * (2 * s.channels)
        self.rows = Rows(rows, [], self._scalars, steps, name=program_name("rows", loss, self._shapes, *self._of))
        self.averages, self.sums = functools.cache(self._averages), functools.cache(self._sums)
        self._prepared: dict[tuple[bytes, ...], Callable[..., np.ndarray]] = {}

    def prepared(self, leaves: Sequence[np.ndarray]) -> Callable[..., np.ndarray]:
        """What loops that are prepared are given, of a program's rows, a part, and its free numbers as bytes.

        Problems of the same numbers that are not free share it.
        """
        key = tuple(a.tobytes() for a in leaves)
        made = self._prepared.get(key)
        if made is None:
            of_parts = [
                np.concatenate([a.ravel() for a in self.parts.leaves(leaves, m)])
                for m in range(len(self.parts.channels))
            ]
            made = functools.lru_cache(LAST)(
                lambda rows, part, p: rows.parameters([], np.append(np.frombuffer(p), of_parts[part]))
            )
            self._prepared = {key: made}
        return made

    def _kept_shapes(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Shapes of the lobes and of their slopes, which a trace shows, or an earlier process has written down."""
        name = program_name("lobes", *self._of) if files.keeping() else ""
        if name and (data := files.read(name)):
            values, slopes = json.loads(data)
            return tuple(values), tuple(slopes)

        def lobes(p: Array, known: list[Array]) -> Lobes:
            return lobes_at_sample(self._s, p, jax.tree.unflatten(self._tree, known)[0], up, up)

        up = Direction(*NORMAL)
        made = jax.eval_shape(lobes, *(np.zeros(self._s.size), [np.zeros(shape) for shape in self._fixed]))
        if name:
            files.write(name, json.dumps([made.values.shape, made.slopes.shape]).encode())
        return made.values.shape, made.slopes.shape

    def _averages(self, cut: tuple[bool, bool] | None) -> AddingProgram:
        """Of lobes times weights over nodes, of discs that the horizon cuts or does not; None: over pairs of nodes."""
        numbers, axes = (NODE, 9) if cut is None else (2 * NODE, 6)

        def rows(_: Sequence[Any], *elements: Array) -> Array:
            p, (fixed, _, tan_s), others = taken(self._s, self._tree, self._fixed, elements)
            nodes, axes = others[:numbers], others[numbers:]
            wi, wo, weight = _pair(axes, tan_s, nodes) if cut is None else _both(axes, tan_s, nodes, cut)
            lobes = lobes_at_sample(self._s, p, fixed, wi, wo)
            return jnp.concatenate([weight[None], *(weight * a.reshape(-1) for a in lobes)])

        apart, name = any(map(prepared, self._s.frames)), program_name("averages", cut, *self._of)
        with LOCK:
            formula = Rows(rows, [], self._scalars, (1,) * axes, numbers, name=name, prepared=apart)
            return AddingProgram(formula, 1 + self.lobes)

    def moved(self, averages: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Averages of a part's lobes, which change by their slopes where its numbers move by a step."""
        moved, shape = averages.copy(), self._shapes[0]
        split = 1 + shape[0] * shape[1]
        values, slopes = moved[1:split].reshape(*shape, -1), averages[split:].reshape(-1, shape[1], averages.shape[1])
        shapes = [g for t in range(shape[0]) for g in self._s.free if g.term == t and not g.linear]
        for g, slope in zip(shapes, slopes, strict=True):
            values[g.term] += step[self._s.of(g), None] * slope
        return moved

    def _sums(self, full: bool) -> SumsProgram:
        """Of products of rows; `full` with those times residuals, and f."""
        number = self.channels * self.size
        pairs = pairs_of_rows(self.channels, self.size, 0)
        with LOCK:
            if not full:
                return SumsProgram(self.rows, pairs)
            more = pairs_of_rows(self.channels, self.size, number)
            return SumsProgram(self.rows, [*pairs, *more], range(2 * number, 2 * number + self.channels))


def _pair(axes: Sequence[Array], tan_s: Array, node: Sequence[Array]) -> tuple[Direction, Direction, Array]:
    """(direction of light, of detector, weight) of a pair of nodes; the axes' last is the normal of their plane."""
    wi, wo, normal = (Direction(*axes[k : k + 3]) for k in (0, 3, 6))
    side_i, side_o = jnp.where(wi.z < 0, -1.0, 1.0), jnp.where(wo.z < 0, -1.0, 1.0)
    x_i, y_i, x_o, y_o, w = node
    wi, share_i = ray_about(turned_over(wi, side_i), normal, tan_s[0] * x_i, tan_s[0] * y_i)
    wo, share_o = ray_about(turned_over(wo, side_o), normal, tan_s[1] * x_o, tan_s[1] * y_o)
    return turned_over(wi, side_i), turned_over(wo, side_o), w * share_i * share_o


def _both(
    axes: Sequence[Array], tan_s: Array, nodes: Sequence[Array], cut: tuple[bool, bool]
) -> tuple[Direction, Direction, Array]:
    """The same of a node of each disc."""
    wi, share_i = _ray(Direction(*axes[:3]), tan_s[0], nodes[:NODE], cut[0])
    wo, share_o = _ray(Direction(*axes[3:]), tan_s[1], nodes[NODE:], cut[1])
    return wi, wo, share_i * share_o


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
    """The numbers (2 · NODE, K) of the pairs of nodes of a rule, or (NODE, K) where it is one of pairs."""
    rules, of_discs = disc_rules(half_angles), []
    first = int(rules.first[rule])
    if first >= 0:
        turn = -1.0 if rule % KINDS == OPPOSED else 1.0
        nodes = np.asarray(rules.pairs)[:, first : first + int(rules.sizes[rule])]
        return np.ascontiguousarray(nodes * np.array([1.0, 1.0, turn, turn, 1.0])[:, None])
    for d in range(2):
        n, m = rules.shape[rule, d]
        columns, rows = np.asarray(rules.columns)[rule, d, :n], np.asarray(rules.rows)[rule, d, :m]
        of_discs.append(np.hstack([np.repeat(columns, m, axis=0), np.tile(rows, (n, 1))]))
    first, second = np.indices([len(a) for a in of_discs]).reshape(2, -1)
    return np.ascontiguousarray(np.hstack([of_discs[0][first], of_discs[1][second]]).T)


class _LastAverages:
    """The averages of all pieces at the numbers where they were formed last, by the piece's place."""

    def __init__(self) -> None:
        """Nothing is known yet."""
        self._numbers = b""
        self._pieces: dict[int, list[np.ndarray]] = {}

    def of(self, p: np.ndarray) -> dict[int, list[np.ndarray]]:
        """Those at numbers p (P,), as far as they are known: to be filled by whoever forms more."""
        if self._numbers != p.tobytes():
            self._numbers, self._pieces = p.tobytes(), {}
        return self._pieces


class _Piece(NamedTuple):
    """Some readings of one rule, padded: where they stand, |cosθi|, targets and weights.

    `averaged`: where the rows of nodes and axes begin.
    """

    rule: int
    cells: np.ndarray
    cosine: np.ndarray
    target: np.ndarray
    weight: np.ndarray
    averaged: np.ndarray
    kept: tuple[np.ndarray, np.ndarray]


class BoundAverages:
    """The sums of one problem's readings."""

    def __init__(self, programs: _Programs, leaves: list[np.ndarray], readings: AveragedReadings) -> None:
        """Of the programs, the numbers that they do not take as free, and the readings."""
        self._programs, self._readings, self._leaves = programs, readings, leaves
        self._places = np.hstack([programs.parts.addresses(a) for a in leaves])
        self._prepared = programs.prepared(leaves)
        self._pieces = [
            piece
            for rule in np.unique(readings.rules).tolist()
            for piece in _pieces(readings, rule, np.flatnonzero(readings.rules == rule))
        ]
        self._last = _LastAverages()

    def compared_with(self, target: np.ndarray, weight: np.ndarray) -> "BoundAverages":
        """The sums of the same readings with other targets and weights (n, C): what is averaged serves both."""
        other = copy.copy(self)
        other._readings = self._readings._replace(target=target, weight=weight)
        other._pieces = [
            piece._replace(target=_padded(target, piece), weight=_padded(weight, piece)) for piece in self._pieces
        ]
        return other

    def __call__(self, p: Float[np.ndarray, "s p"], full: bool) -> Sums | None:
        """The sums at S vectors of free numbers, `full` with f of one of them; None where XLA has to compute them."""
        return self._run(np.ascontiguousarray(p, float), full)

    def values_near(self, p: Float[np.ndarray, " p"], step: Float[np.ndarray, " p"]) -> Float[np.ndarray, "n c"] | None:
        """f of the readings at p + step, to first order in the step of shapes; None where XLA has to compute it."""
        sums = self._run(np.array(p[None], float), True, np.asarray(step, float))
        return None if sums is None else sums.f

    def _run(self, p: np.ndarray, full: bool, step: np.ndarray | None = None) -> Sums | None:
        """The sums at each vector p (S, P), of averages there; `step` (P,): to first order in it, a step further."""
        pieces, channels = self._pieces, self._programs.channels
        try:
            programs = [self._averages(piece.rule) for piece in pieces], self._programs.sums(full)
        except Unsupported:
            return None
        f = np.zeros(self._readings.weight.shape) if full else None
        known, there = self._known(p), p if step is None else p + step
        sums: list[list[np.ndarray | None]] = [[None] * len(pieces) for _ in p]

        def work(first: int, last: int) -> int:
            for k in range(first, last):
                s, number = divmod(k, len(pieces))
                piece, lobes = pieces[number], None if known is None else known.get(number)
                if lobes is None:
                    lobes = self._averages_of(piece, programs[0][number], p[s])
                if lobes is not None:
                    if known is not None:
                        known[number] = lobes
                    lobes = lobes if step is None else self._moved(lobes, step)
                    sums[s][number] = self._sums_of(piece, programs[1], there[s], lobes, f)
            return 0

        together = len(p) * len(pieces)
        alone = len(p) * sum(len(piece.target) * piece.kept[0].shape[1] for piece in pieces) <= ALONE
        workers.share(work, together, together if alone else 1)
        if any(part is None for row in sums for part in row):
            return None
        total = np.array(sums, float).reshape(len(p), len(pieces), -1).sum(axis=1)
        squares = squares_of_pairs(total.reshape(-1, programs[1].products), 1 + full, channels)
        return Sums(self._programs.parts.joined_squares(squares.reshape(len(p), -1, *squares.shape[1:])), f)

    def _known(self, p: np.ndarray) -> dict[int, list[np.ndarray]] | None:
        """What is known of the averages at one vector (1, P), by piece; None of several, and of what would be large."""
        rows = self._programs.averaged_parts * (1 + self._programs.lobes)
        kept = len(p) == 1 and rows * len(self._readings.weight) <= MOST_KEPT
        return self._last.of(p[0]) if kept else None

    def _averages(self, rule: int) -> AddingProgram:
        rules = disc_rules(self._readings.half_angles)
        if rules.first[rule] >= 0:
            return self._programs.averages(None)
        cut = rules.counts[rule] > 1 if rule % KINDS == CUT else np.zeros(2, bool)
        return self._programs.averages((bool(cut[0]), bool(cut[1])))

    def _averages_of(self, piece: _Piece, program: AddingProgram, p: np.ndarray) -> list[np.ndarray] | None:
        """Sums of weights, and of weights times lobes, over the nodes of a piece; in each part that has its own."""
        parts, sizes, averages = self._programs.parts, (piece.kept[0].shape[1], len(piece.target)), []
        for m, numbers in enumerate(parts.numbers[: self._programs.averaged_parts]):
            if program.rows.prepared:
                places, parameters = piece.averaged, self._prepared(program.rows, m, p[numbers].tobytes())
            else:
                places, parameters = np.append(self._scalars(p, m), piece.averaged), NOTHING
            averages.append(program(parameters, places, sizes))
        return None if any(a is None for a in averages) else averages

    def _scalars(self, p: np.ndarray, part: int) -> np.ndarray:
        """Where the numbers of a part stand: free ones in p (P,), and the others."""
        return np.append(p.ctypes.data + 8 * self._programs.parts.numbers[part], self._places[part]).astype(np.uintp)

    def _moved(self, averages: list[np.ndarray], step: np.ndarray) -> list[np.ndarray]:
        """The averages of lobes where numbers have moved by a step (P,), to first order."""
        programs = self._programs
        return [programs.moved(a, step[programs.parts.numbers[m]]) for m, a in enumerate(averages)]

    def _sums_of(
        self, piece: _Piece, program: SumsProgram, p: np.ndarray, averages: list[np.ndarray], f: np.ndarray | None
    ) -> np.ndarray | None:
        """Sums over the readings of a piece, of all parts; their values go to `f`."""
        parts, sums = self._programs.parts, []
        values = np.zeros((len(parts.channels), len(piece.target), self._programs.channels))
        for m in range(len(parts.numbers)):
            lobes = averages[min(m, len(averages) - 1)]
            strided = [a.ctypes.data + 8 * parts.channels[m] for a in (piece.target, piece.weight)]
            places = [piece.cosine.ctypes.data], _rows_of(lobes), *strided, [values[m].ctypes.data] * (f is not None)
            addresses = np.concatenate([self._scalars(p, m), *places]).astype(np.uintp)
            sums.append(program(NOTHING, addresses[None], len(piece.target)))
        if f is not None:
            f[piece.cells] = parts.joined_values(values)[: piece.cells.size]
        return None if any(a is None for a in sums) else np.concatenate(sums, axis=1)[0]


def _padded(a: np.ndarray, piece: _Piece) -> np.ndarray:
    """Values of the readings (n, C), of a piece's alone and 0 beyond them."""
    laid = np.zeros_like(piece.target)
    laid[: piece.cells.size] = a[piece.cells]
    return laid


def _rows_of(a: np.ndarray) -> np.ndarray:
    """Where the rows of an array begin."""
    return a.ctypes.data + a.strides[0] * np.arange(len(a))


def _pieces(r: AveragedReadings, rule: int, cells: np.ndarray) -> list[_Piece]:
    """The readings of one rule in pieces: parts of arrays that are laid out once."""
    n, channels = cells.size, r.target.shape[1]
    size = n + -n % LANES
    wi, wo = (Direction(*(np.asarray(c)[cells] for c in w)) for w in (r.wi, r.wo))
    rows, fill = [*wi, *wo], [*NORMAL, *NORMAL]
    if disc_rules(r.half_angles).first[rule] >= 0:
        light, detector = (turned_over(w, np.where(w.z < 0, -1.0, 1.0)) for w in (wi, wo))
        rows += pair_normal(light, detector, np)
        fill += [1.0, 0.0, 0.0]
    axes, target, weight = np.empty((len(rows), size)), np.zeros((size, channels)), np.zeros((size, channels))
    for row, c, e in zip(axes, rows, fill, strict=True):
        row[:n], row[n:] = c, e
    target[:n], weight[:n] = r.target[cells], r.weight[cells]
    cosine, nodes, pieces = np.abs(axes[2]), _nodes(r.half_angles, rule), []
    together = min(max(WORK // nodes.shape[1] // LEAST * LEAST, LEAST), MOST)
    for first in range(0, size, together):
        s = slice(first, min(first + together, size))
        places = np.concatenate([_rows_of(nodes), _rows_of(axes[:, s])]).astype(np.uintp)
        pieces.append(_Piece(rule, cells[s], cosine[s], target[s], weight[s], places, (nodes, axes)))
    return pieces


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
    leaves = [np.asarray(a, float, order="C") for a in leaves]
    key = (s, loss, tree, tuple(a.shape for a in leaves))
    programs = kept(_kept, key, lambda: _Programs(s, loss, leaves, tree))
    return None if programs is None else BoundAverages(programs, leaves, readings)
