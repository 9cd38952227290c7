"""The least-squares problem of a fit: the residuals of a model with all that follows from them.

A free number that belongs to one channel touches only that channel's residuals, so that each channel adds a small
square matrix of (free parameters a channel sees)², whatever the number of channels, and the sum over all is an `Arrow`.
"""

import collections
import dataclasses
import functools
from collections.abc import Iterable, Iterator
from typing import Any

import jax
import numpy as np

from gonio.fitting.problem.averaged_sums import AveragedReadings, BoundAverages, bound_averages
from gonio.fitting.problem.compiled_sums import BoundSums, Sums, bound_sums, sums_of_samples
from gonio.fitting.problem.deferred_arrays import DeferredValues
from gonio.fitting.problem.disc_averages import BlockRules, Lanes, Samples, block_rules, disc_rules, program_rules
from gonio.fitting.problem.normal_equations import Evaluation, NormalEquations, summed, summed_pairs
from gonio.fitting.problem.page_program import Request, page_program
from gonio.fitting.problem.parameterisation import Domains, FixedValues, Parameterisation
from gonio.fitting.problem.readings import (
    IDENTITIES,
    LANES,
    PAGE,
    POINTS,
    AnyArray,
    Readings,
    block_of,
    block_shape,
    chunks,
    in_blocks,
    laid_directions,
    rows_of,
    transform,
    transformed,
    uses_cosine,
)
from gonio.fitting.problem.stored_sums import Pieces, StoredSums
from gonio.fitting.problem.table_rows import Rows
from gonio.models.geometry.directions import NORMAL, Direction

MANY = 1 << 21  # readings, channels counted apart
NONE = np.zeros((0, 0))
UNDER_WAY = 8  # pages whose results are waited for at a time


@dataclasses.dataclass(frozen=True)
class FitProblem:
    """All that the cost ½Σ(w(T(f c) − T(y c)))² depends on besides the free numbers.

    Attributes:
        parameters: the model, its free numbers taken out (P of them).
        fixed: the other numbers of each term, by path.
        loss: name of T and c, see `readings`.
        domains: closed domains of the free numbers.
        readings: directions (n,) and values y (n, C), 1/sr.
        weight: w of each residual (n, C), 0 where there is no reading.
        targets: T(y c) of the readings, (n, C).
        floor: of the loss.
        target_norm_squared: Σ(w T(y c))².
        rules: number of the rule (n,) by which the model is averaged over the discs of each reading, see
            `disc_averages`; None: at their centres.
        alike: sums of averages of a problem that differs in targets and weights alone.
        pieces: of readings that stay in their table, whose weights and targets are deferred; None of others.
    """

    parameters: Parameterisation
    fixed: FixedValues
    loss: str
    domains: Domains
    readings: Readings
    weight: np.ndarray
    targets: np.ndarray
    floor: float
    target_norm_squared: float
    rules: np.ndarray | None = None
    alike: BoundAverages | None = None
    pieces: Pieces | None = None

    @classmethod
    def create(
        cls,
        parameters: Parameterisation,
        fixed: FixedValues,
        loss: str,
        readings: Readings,
        weight: np.ndarray,
        floor: float,
        rules: np.ndarray | None = None,
    ) -> "FitProblem":
        """The problem of some readings with weights (n, C) and a loss with this floor."""
        if readings.rows is not None and isinstance(weight, DeferredValues) and rules is None:
            return cls._stored(parameters, fixed, loss, readings, weight, floor)
        readings = readings.in_memory
        n, channels = readings.f.shape
        targets, weight = _laid(readings.f, fresh=loss not in IDENTITIES), _laid(weight)
        cosine = np.abs(np.asarray(readings.wi.z))[:, None] if uses_cosine(loss) else None
        norm_squared = 0.0
        for some in chunks(n, channels):
            compared = targets[some] if cosine is None else targets[some] * cosine[some]
            if loss not in IDENTITIES:
                targets[some] = transformed(loss, compared, floor)
            norm_squared += float(np.sum((weight[some] * targets[some]) ** 2))
        wi, wo = (laid_directions(w, channels) for w in (readings.wi, readings.wo))
        readings = dataclasses.replace(readings, wi=wi, wo=wo)
        return cls(
            parameters, fixed, loss, parameters.domains, readings, weight, targets, float(floor), norm_squared, rules
        )

    @classmethod
    def _stored(
        cls, s: Parameterisation, fixed: FixedValues, loss: str, readings: Readings, weight: np.ndarray, floor: float
    ) -> "FitProblem":
        """The problem of readings that stay in their table."""

        def targets(some: Rows) -> np.ndarray:
            return readings.f[some] if loss in IDENTITIES else _compared_values(readings, loss, floor, some)

        deferred: Any = DeferredValues(targets, readings.f.shape)
        pieces = Pieces(readings, deferred, weight, float(floor))
        norm_squared = sum(float(np.sum((p.samples.weight * p.samples.target) ** 2)) for p in pieces)
        return cls(s, fixed, loss, s.domains, readings, weight, deferred, float(floor), norm_squared, pieces=pieces)

    @property
    def in_memory(self) -> "FitProblem":
        """The same problem with its readings as arrays."""
        if self.pieces is None:
            return self
        weight = np.asarray(self.weight)
        return FitProblem.create(self.parameters, self.fixed, self.loss, self.readings.in_memory, weight, self.floor)

    @property
    def linear(self) -> np.ndarray:
        """Which free numbers (P,) f is proportional to."""
        return self.parameters.linear

    @property
    def order(self) -> np.ndarray:
        """Index, among the free numbers, of each number of the arrow (P,)."""
        return self.parameters.order

    @functools.cached_property
    def lanes(self) -> Lanes | None:
        """Where the readings are laid in blocks; None: one after another."""
        if self.rules is None or not self._averages:
            return None
        return Lanes.of(self.rules, self.readings.half_angles, block_of(self.parameters.channels))

    @property
    def size(self) -> int:
        """Samples in the blocks that are in use, their padding included."""
        number = self.weight.shape[0] if self.lanes is None else self.lanes.source.size
        block = block_of(self.parameters.channels)
        return -(-number // block) * block

    @functools.cached_property
    def samples(self) -> Samples:
        """The readings in blocks, as XLA's programs take them."""
        lanes, channels, readings = self.lanes, self.parameters.channels, self.readings
        shape = block_shape(self.weight.shape[0] if lanes is None else lanes.source.size, channels)
        wi, wo = (_in_blocks(w, lanes, shape) for w in (readings.wi, readings.wo))
        target, weight = (
            in_blocks(a if lanes is None else lanes.values(a), (*shape, channels)) for a in (self.targets, self.weight)
        )
        blocks, used = block_rules(lanes, shape[0]), self.size // shape[1]
        discs = disc_rules(readings.half_angles)
        return Samples(wi, wo, target, weight, np.asarray(used), np.asarray(self.floor), blocks, discs)

    @functools.cached_property
    def _pages(self) -> list[Samples]:
        return list(_pages_of(self.samples))

    @property
    def pages(self) -> Iterable[Samples]:
        """The pages in use, each as `Samples` of `PAGE` blocks."""
        if self.pieces is None:
            return self._pages
        return (page for piece in self.pieces for page in _pages_of(piece.samples))

    def weights(self) -> Iterator[np.ndarray]:
        """The weights of all residuals in turn, (m, C) each or (B, m, C)."""
        if self.pieces is not None:
            return (np.asarray(piece.samples.weight) for piece in self.pieces)
        return (self.weight[some] for some in chunks(*self.weight.shape))

    def subset(self, cells: np.ndarray) -> "FitProblem":
        """The same problem on some of the cells."""
        if cells.size == self.weight.shape[0]:
            return self
        return self.averaged(self.rules, cells)

    def compared_with(self, target: np.ndarray, cells: np.ndarray) -> "FitProblem":
        """The same problem on some of the cells, with targets T(y c) of these, (m, C)."""
        if cells.size == self.weight.shape[0]:
            return self.retargeted(target)
        rules = None if self.rules is None else self.rules[cells]
        readings, weight = self.readings.part(cells), rows_of(self.weight, cells)
        # Laid out once for all targets that they are compared with.
        wi, wo = (laid_directions(w, weight.shape[1]) for w in (readings.wi, readings.wo))
        readings, weight = dataclasses.replace(readings, wi=wi, wo=wo), _laid(weight)
        part = dataclasses.replace(self, readings=readings, weight=weight, rules=rules, alike=None, pieces=None)
        return part.retargeted(target)

    def averaged(self, rules: np.ndarray | None, cells: np.ndarray | None = None) -> "FitProblem":
        """The same problem with the model averaged by these rules (n,), on some of the cells if given."""
        readings, weight = self.readings, self.weight
        if cells is not None:
            readings, weight = readings.part(cells), rows_of(weight, cells)
            rules = None if rules is None else rules[cells]
        if rules is None:
            return FitProblem.create(self.parameters, self.fixed, self.loss, readings, weight, self.floor)
        if cells is None:
            return dataclasses.replace(self.in_memory, rules=rules, alike=None)
        targets = self.targets[cells]
        norm_squared = float(np.sum((weight * targets) ** 2))
        return dataclasses.replace(
            self, readings=readings, weight=weight, targets=targets, target_norm_squared=norm_squared, rules=rules,
            alike=None, pieces=None,
        )  # fmt: skip

    def reweighted(self, weight: np.ndarray) -> "FitProblem":
        """The same problem with other weights (n, C); no array changes its shape, and nothing compiles again."""
        return self.in_memory._compared_anew(_laid(weight), None)

    def retargeted(self, target: np.ndarray) -> "FitProblem":
        """The same problem with other targets T(y c), (n, C)."""
        return self.in_memory._compared_anew(None, _laid(target))

    def _compared_anew(self, weight: np.ndarray | None, targets: np.ndarray | None) -> "FitProblem":
        weight, targets = self.weight if weight is None else weight, self.targets if targets is None else targets
        alike, norm_squared = self._loop if self._averages else None, float(np.sum((weight * targets) ** 2))
        other = dataclasses.replace(self, weight=weight, targets=targets, target_norm_squared=norm_squared)
        return dataclasses.replace(other, alike=alike if isinstance(alike, BoundAverages) else None)

    def linearised(self) -> "FitProblem":
        """The problem of f itself, its residuals to first order in f − y: for `normal_equations(plain=True)`."""
        if self.pieces is not None:
            return self.in_memory.linearised()
        cosine = self.readings.cos_i[:, None] if uses_cosine(self.loss) else 1.0
        with np.errstate(all="ignore"):
            slope = transform(self.loss, self.readings.f * cosine, self.floor, np)[1]
            return self.retargeted(self.readings.f).reweighted(self.weight * slope * cosine)

    def compared(self, f: np.ndarray) -> np.ndarray:
        """T(f c), (n, C), of values f (n, C) at the readings' directions."""
        return compared(self.readings, self.loss, self.floor, f)

    def residuals(self, f: np.ndarray) -> np.ndarray:
        """w (T(f c) − T(y c)), (n, C), for the model's values f; 0 where there is no reading."""
        return weighted_residuals(self.readings, self.loss, self.floor, self.weight, f)

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None, plain: bool = False) -> NormalEquations:
        """The normal equations at up to `LANES` vectors p (S, P); of the active ones, zero for the others.

        `plain`: residuals w(f − target), whatever the loss.
        """
        bound, number = self._loop_of_f if plain else self._loop, len(p)
        use = None if active is None or active.all() else np.flatnonzero(active)
        pairs = None
        if isinstance(bound, BoundSums | StoredSums):
            pairs = bound.pairs(p if use is None else p[use])
        if pairs is None:
            return summed(self.parameters, self._squares(p, active, plain)[:, 0])
        if use is not None:
            of_active, pairs = pairs, np.zeros((number, *pairs.shape[1:]))
            pairs[use] = of_active
        return summed_pairs(self.parameters, pairs)

    def channel_costs(self, p: np.ndarray) -> np.ndarray:
        """½ Σ r² of each channel, at up to `LANES` vectors p (S, P): (S, C)."""
        return 0.5 * self._squares(p)[:, 0, :, 0, 0]

    def evaluate(self, p: np.ndarray, scores: bool = True) -> Evaluation:
        """Normal equations at one p (P,), score covariance [White 1980] and the model's values.

        The values at more than `MANY` readings are computed where they are asked for.
        """
        p, loop = np.asarray(p, float), self._loop
        total = None
        if self.weight.size > MANY and isinstance(loop, BoundSums | StoredSums):
            total = loop.scored(p[None])
        if total is None and self.pieces is not None:
            total = _total([page[0] for page in self._run(p[None], scores=scores)], 1)
        if total is None:
            total, f = self._squares_and_values(p[None], scores)
        else:
            # What computes values later holds no samples.
            bare = dataclasses.replace(self, weight=NONE, targets=NONE, rules=None, alike=None, pieces=None)
            f = DeferredValues(functools.partial(_values, bare, self.readings, p), self.weight.shape)
        equations, outer = (summed(self.parameters, total[:, k]) for k in range(2))
        one, spread = (jax.tree.map(lambda a: a[0], e) for e in (equations, outer.matrix))
        return Evaluation(one, spread if scores else None, f)

    def model_values(self, p: np.ndarray) -> np.ndarray:
        """The model's f (n, C) at the readings' directions, for free numbers p (P,)."""
        values = self._loop.values(p) if isinstance(self._loop, BoundSums) else None
        return self.evaluate(p, scores=False).f if values is None else values

    def values_near(self, p: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The model's f (n, C) at p + step (P,); where it is averaged, to first order in the step."""
        values = self._loop.values_near(p, step) if isinstance(self._loop, BoundAverages) else None
        return self.model_values(p + step) if values is None else values

    def values_at(self, p: np.ndarray, wi: Direction, wo: Direction) -> np.ndarray:
        """The model's f (n, C) at other directions (n,), by the same compiled program.

        They are read where they are, if they are laid out (`laid_directions`).
        """
        n, channels = wi.z.size, self.parameters.channels
        wi, wo = (laid_directions(w, channels) for w in (wi, wo))
        if (make := sums_of_samples(self.parameters, self.loss, self.fixed, np.asarray(self.floor))) is not None:
            # Values depend on no targets and no weights, which no program of theirs reads.
            few, blocks = np.zeros((1, 1, channels)), block_rules(None, 0)
            samples = Samples(wi, wo, few, few, np.asarray(0), np.asarray(self.floor), blocks, disc_rules(POINTS))
            values = make(samples, n).values(p)
            if values is not None:
                return values
        none = _laid(np.broadcast_to(0.0, (n, channels)))
        elsewhere = dataclasses.replace(
            self,
            readings=Readings(wi, wo, none, none, none > 0),
            weight=none,
            targets=none,
            rules=None,
            alike=None,
            pieces=None,
        )
        return elsewhere.model_values(p)

    def _squares(self, p: np.ndarray, active: np.ndarray | None = None, plain: bool = False) -> np.ndarray:
        """Products of residuals and derivatives at vectors p (S, P): as of `page_program`; 0 for what is not active."""
        number = len(p)
        use = None if active is None or active.all() else np.flatnonzero(active)
        sums = self._sums(p if use is None else p[use], plain)
        if sums is None:
            return _total([page[0] for page in self._run(p, active, plain=plain)], number)
        if use is None:
            return sums.squares
        squares = np.zeros((number, *sums.squares.shape[1:]))
        squares[use] = sums.squares
        return squares

    def _squares_and_values(self, p: np.ndarray, scores: bool) -> tuple[np.ndarray, np.ndarray]:
        """The same at one vector p (1, P), with the score covariance, and f of the readings (n, C)."""
        sums = self._sums(p, full=True)
        if sums is not None and sums.f is not None:
            return sums.squares, sums.f
        f, squares = np.zeros(self.samples.weight.shape), []
        for k, (of_page, f_of_page) in enumerate(self._run(p, scores=scores)):
            squares.append(of_page)
            rows = f[k * PAGE : (k + 1) * PAGE]
            rows[:] = np.swapaxes(np.asarray(f_of_page)[: rows.shape[0]], 1, 2)
        f = f.reshape(-1, self.parameters.channels)
        return _total(squares, 1), f[: self.weight.shape[0]] if self.lanes is None else f[self.lanes.place]

    def _sums(self, p: np.ndarray, plain: bool = False, full: bool = False) -> Sums | None:
        bound = self._loop_of_f if plain else self._loop
        return None if bound is None else bound(p, full)

    @functools.cached_property
    def _loop(self) -> BoundSums | StoredSums | BoundAverages | None:
        return self._bound(self.loss)

    @functools.cached_property
    def _loop_of_f(self) -> BoundSums | StoredSums | BoundAverages | None:
        return self._bound("linear")

    @property
    def _averages(self) -> bool:
        """Whether the model is averaged over discs."""
        return self.rules is not None and bool(self.rules.any())

    def _bound(self, loss: str) -> BoundSums | StoredSums | BoundAverages | None:
        if self.pieces is not None:
            make = sums_of_samples(self.parameters, loss, self.fixed, np.asarray(self.floor))
            return None if make is None else StoredSums(make, self.pieces)
        if self.rules is None or not self._averages:
            return bound_sums(self.parameters, loss, self.fixed, self.samples, self.weight.shape[0])
        if self.alike is not None and loss == self.loss:
            return self.alike.compared_with(self.targets, self.weight)
        readings, half_angles = self.readings, self.readings.half_angles
        of = AveragedReadings(readings.wi, readings.wo, self.targets, self.weight, self.rules, half_angles)
        return bound_averages(self.parameters, loss, self.fixed, self.floor, of)

    def _run(
        self, p: np.ndarray, active: np.ndarray | None = None, scores: bool = False, plain: bool = False
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """What the program gives for each page in turn; a few pages are under way, on several processors."""
        program, number = page_program(self.parameters, self.loss), len(p)
        lanes, order = np.zeros((LANES, self.parameters.size)), np.zeros(LANES, np.int32)
        lanes[:number] = p
        use = np.flatnonzero(np.broadcast_to(True if active is None else active, (number,)))
        order[: use.size] = use
        request = Request(np.asarray(use.size, np.int32), np.asarray(scores), np.asarray(plain))
        # Loops look at no rules: as XLA takes them they are there where it is asked, for they are many numbers.
        waiting, discs = collections.deque(), program_rules(self.readings.half_angles)
        for page in self.pages:
            waiting.append(program(lanes, order, request, self.fixed, page._replace(discs=discs)))
            if len(waiting) == UNDER_WAY:
                yield waiting.popleft()
        yield from waiting


def _pages_of(whole: Samples) -> Iterator[Samples]:
    """The pages in use of some samples, without copies."""
    used = int(whole.blocks)
    for first in range(0, used, PAGE):
        cut = slice(first, first + PAGE)
        wi, wo = (Direction(*(c[cut] for c in w)) for w in (whole.wi, whole.wo))
        blocks, rules = np.asarray(min(PAGE, used - first)), BlockRules(*(a[cut] for a in whole.rules))
        yield Samples(wi, wo, whole.target[cut], whole.weight[cut], blocks, whole.floor, rules, whole.discs)


def _values(problem: FitProblem, readings: Readings, p: np.ndarray, rows: Rows) -> np.ndarray:
    """The model's f (m, C) at some of the readings."""
    return problem.values_at(p, *readings.directions(rows))


def _laid(a: np.ndarray, fresh: bool = False) -> np.ndarray:
    """Values (n, C) where `in_blocks` takes them without a copy."""
    n, channels = a.shape
    return in_blocks(a, (*block_shape(n, channels), channels), fresh=fresh).reshape(-1, channels)[:n]


def _in_blocks(w: Direction, lanes: Lanes | None, shape: tuple[int, int]) -> Direction:
    components = [np.asarray(c) for c in w]
    if lanes is not None:
        components = [lanes.directions(c, e) for c, e in zip(components, NORMAL, strict=True)]
    return Direction(*(in_blocks(c, shape, e) for c, e in zip(components, NORMAL, strict=True)))


def _total(squares: list[np.ndarray], number: int) -> np.ndarray:
    return np.sum([np.asarray(s) for s in squares], axis=0, dtype=float)[:number]


def _compared_values(readings: Readings, loss: str, floor: float, rows: Rows) -> np.ndarray:
    """T(y c) of some of the readings; their directions are not looked at where the loss has no cosine."""
    f = readings.f[rows]
    return transformed(loss, f * readings.cos_i[rows, None] if uses_cosine(loss) else f, floor)


def compared(readings: Readings, loss: str, floor: float | AnyArray, f: np.ndarray) -> np.ndarray:
    """T(f c) of a loss at the readings' directions, for values f (n, C); the floor may be one for each channel."""
    c = readings.cos_i[:, None] if uses_cosine(loss) else 1.0
    return transformed(loss, f * c, floor)


def weighted_residuals(
    readings: Readings, loss: str, floor: float | AnyArray, weight: np.ndarray, f: np.ndarray
) -> np.ndarray:
    """w (T(f c) − T(y c)), (n, C), for the model's values f; 0 where there is no reading."""
    difference = compared(readings, loss, floor, f) - compared(readings, loss, floor, readings.f)
    return np.where(weight > 0, weight * difference, 0.0)
