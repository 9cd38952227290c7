"""The least-squares problem of a fit: the residuals of a model with all that follows from them.

The Jacobian is never stored: a block's rows are formed, multiplied and forgotten. A free number that belongs to one
channel touches only that channel's residuals, so that each channel adds a small square matrix of (free parameters a
channel sees)², whatever the number of channels, and the sum over all is an `Arrow`. One compiled program for each model
and loss takes a page of samples and up to `LANES` vectors of free numbers; how many of both are in use is data, so that
it serves every table and every stage of a fit.
"""

import collections
import dataclasses
import functools
import operator
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.core as jax_core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from gonio.fitting.problem.arrow import Arrow, joined
from gonio.fitting.problem.disc_averages import BlockRules, Lanes, NodePairs, Samples, block_rules, disc_rules
from gonio.fitting.problem.parameterisation import Domains, FixedValues, Parameterisation
from gonio.fitting.problem.readings import (
    LANES,
    PAGE,
    POINTS,
    AnyArray,
    Readings,
    block_of,
    block_shape,
    chunks,
    in_blocks,
    transform,
    transformed,
    uses_cosine,
)
from gonio.models.compiling import options
from gonio.models.expression.builder import Frame, assemble
from gonio.models.expression.parser import FACTOR
from gonio.models.geometry.directions import NORMAL, Direction

UNDER_WAY = 8  # pages whose results are waited for at a time


class NormalEquations(NamedTuple):
    """Sums over all residuals r with the rows J of their Jacobian by the parameters; any leading axes.

    The parameters are in the order of the arrow, see `Parameterisation.order`.
    """

    cost: Float[np.ndarray, "*s"]  # ½ Σ r²
    gradient: Float[np.ndarray, "*s p"]  # Jᵀ r
    matrix: Arrow  # JᵀJ


class Request(NamedTuple):
    """What a program computes: for how many lanes; the score covariance too; of f itself, in place of its loss."""

    lanes: Int[AnyArray, ""]
    scores: Bool[AnyArray, ""]
    plain: Bool[AnyArray, ""]


class _Lobes(NamedTuple):
    """Lobe of each term at strength 1 (T, C, n), and its slope by each shape (shapes, C, n); C may be 1."""

    values: Float[AnyArray, "t c *n"]
    slopes: Float[AnyArray, "s c *n"]


class _Strengths(NamedTuple):
    """Strength of each term (T, C), and by what ∂f/∂(free parameter) is a multiple of its lobe or slope (groups, C)."""

    terms: Float[AnyArray, "t c"]
    factors: Float[AnyArray, "g c"]


def _term_values(s: Parameterisation, index: int, p: Float[AnyArray, " p"], fixed: FixedValues) -> dict[str, Array]:
    """Values of a term's parameters by path: fixed ones, and free ones out of the vector p."""
    values: dict[str, Any] = dict(fixed[index])
    for g in s.free:
        if g.term == index:
            values[g.path] = p[s.of(g)] if g.per_channel else p[g.first]
    return values


def _strengths(s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues) -> _Strengths:
    terms, factors = [], [jnp.ones(())] * len(s.free)
    for index in range(len(s.frames)):
        free = [(k, g) for k, g in enumerate(s.free) if g.term == index]
        values = _term_values(s, index, p, fixed)
        factor = values.get(FACTOR, jnp.ones(()))
        amount = next((values[g.path] for _, g in free if g.linear and g.path != FACTOR), jnp.ones(()))
        terms.append(amount * factor)
        for k, g in free:
            factors[k] = amount if g.path == FACTOR else factor if g.linear else amount * factor
    return _Strengths(_stacked(terms, (s.channels,)), _stacked(factors, (s.channels,)))


def _stacked(arrays: list[Array], shape: tuple[int, ...]) -> Array:
    return jnp.stack([jnp.broadcast_to(a, shape) for a in arrays]) if arrays else jnp.zeros((0, *shape))


def _lobes_at_sample(
    s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, wi: Direction, wo: Direction
) -> _Lobes:
    """The lobes at one sample; C is 1 where no shape differs between channels.

    What f is proportional to (albedo, scale) needs no derivative; one tangent of ones serves all channels of a
    parameter that has a value for each.
    """
    lobes, slopes_of = [], []
    for index, of in enumerate(s.frames):
        free = [g for g in s.free if g.term == index]
        values = _term_values(s, index, p, fixed)
        values.pop(FACTOR, None)
        values |= {g.path: jnp.ones(()) for g in free if g.linear and g.path != FACTOR}

        def lobe(shapes: dict[str, Array], values: dict[str, Array] = values, of: Frame = of) -> Array:
            return assemble(of, {**values, **shapes}).f(wi, wo)

        shapes = {g.path: values[g.path] for g in free if not g.linear}
        if not shapes:
            lobes.append(lobe(shapes))
            continue

        def along(
            tangent: dict[str, Array], shapes: dict[str, Array] = shapes, lobe: Callable[..., Array] = lobe
        ) -> tuple[Array, Array]:
            spread = {n: jnp.broadcast_to(tangent[n], jnp.shape(v)) for n, v in shapes.items()}
            return jax.jvp(lobe, (shapes,), (spread,))

        one_each = {name: jnp.eye(len(shapes))[k] for k, name in enumerate(shapes)}
        value, slopes = jax.vmap(along, out_axes=(None, 0))(one_each)
        lobes.append(value)
        slopes_of += list(slopes)
    width = (max(jnp.size(a) for a in [*lobes, *slopes_of]),)
    return _Lobes(_stacked(lobes, width), _stacked(slopes_of, width))


def _lobes(s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, wi: Direction, wo: Direction) -> _Lobes:
    return jax.vmap(lambda i, o: _lobes_at_sample(s, p, fixed, i, o), out_axes=-1)(wi, wo)


def _averaged_lobes(
    s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, page: Samples, b: Int[AnyArray, ""]
) -> _Lobes:
    """The lobes of block b, averaged over its discs: what f is made of linearly, and its slopes, all at once."""
    wi, wo = (Direction(*(c[b] for c in w)) for w in (page.wi, page.wo))
    pairs = NodePairs.of(page.discs, page.rules.rule[b], page.rules.halvings[b], wi, wo)
    # Traced once: models are long, and shapes and loop would each run through them.
    traced, shapes = jax.make_jaxpr(lambda i, o: _lobes(s, p, fixed, i, o), return_shape=True)(wi, wo)
    leaves, tree = jax.tree.flatten(shapes)

    def add(k: Array, state: tuple[list[Array], Array]) -> tuple[list[Array], Array]:
        sums, weights = state
        *rays, weight = pairs.pair(k)
        lobes = jax_core.eval_jaxpr(traced.jaxpr, traced.consts, *jax.tree.leaves(rays))
        return [a + weight[None, None] * v for a, v in zip(sums, lobes, strict=True)], weights + weight

    start = ([jnp.zeros(h.shape, h.dtype) for h in leaves], jnp.zeros_like(wi.z))
    sums, weights = jax.lax.fori_loop(0, pairs.steps, add, start)
    total = pairs.gathered(weights)
    total = jnp.where(total > 0, total, 1.0)[None, None]
    return jax.tree.unflatten(tree, [pairs.gathered(a) / total for a in sums])


def _sum_of_lobes(lobes: _Lobes, strengths: _Strengths) -> Float[AnyArray, "c n"]:
    each = (lobe * strength[:, None] for lobe, strength in zip(lobes.values, strengths.terms, strict=True))
    return functools.reduce(operator.add, each)


def _rows(s: Parameterisation, lobes: _Lobes, strengths: _Strengths) -> list[Float[AnyArray, "c n"]]:
    """∂f/∂(free parameter) of each free parameter."""
    shapes = iter(lobes.slopes)
    order = sorted(range(len(s.free)), key=lambda k: (s.free[k].term, k))
    rows = {k: lobes.values[s.free[k].term] if s.free[k].linear else next(shapes) for k in order}
    return [rows[k] * strengths.factors[k][:, None] for k in range(len(s.free))]


def _computed(always: Bool[AnyArray, ""], function: Callable[[], Any]) -> Any:
    """The function's values, written to memory: a branch that is always taken, which XLA cannot know.

    XLA would otherwise compute lobes again for every channel, and losses for every derivative that uses them.
    """
    # Traced once: models are long, and shapes and branch would each run through them.
    traced, shapes = jax.make_jaxpr(function, return_shape=True)()
    leaves, tree = jax.tree.flatten(shapes)
    computed = jax.lax.cond(
        always,
        lambda: jax_core.eval_jaxpr(traced.jaxpr, traced.consts),
        lambda: [jnp.zeros(h.shape, h.dtype) for h in leaves],
    )
    return jax.tree.unflatten(tree, computed)


def _block(
    s: Parameterisation,
    loss: str,
    p: Float[AnyArray, " p"],
    fixed: FixedValues,
    page: Samples,
    b: Int[AnyArray, ""],
    plain: Bool[AnyArray, ""],
) -> tuple[Float[AnyArray, "c g n"], Float[AnyArray, "c n"]]:
    """(residuals and under them their derivatives (C, 1 + groups, n), the model's f (C, n)) of block b."""
    always = b < page.blocks
    strengths, cosine = _strengths(s, p, fixed), jnp.abs(page.wi.z[b])
    lobes = _averaged_lobes(s, p, fixed, page, b)

    def compared() -> tuple[Array, Array, AnyArray]:
        f = _sum_of_lobes(lobes, strengths)
        weight = page.weight[b].T
        used = weight > 0
        c = cosine[None, :] if uses_cosine(loss) else jnp.ones_like(cosine)[None, :]
        value, slope = transform(loss, f * c, page.floor)
        value, slope = jnp.where(plain, f, value), jnp.where(plain, 1.0, slope * c)
        residual = jnp.where(used, weight * (value - page.target[b].T), 0.0)
        return residual, jnp.where(used, weight * slope, 0.0), f

    residual, by_f, f = _computed(always, compared)

    def rows() -> Array:
        return jnp.stack([residual, *(row * by_f for row in _rows(s, lobes, strengths))], axis=1)

    return _computed(always, rows), f


@functools.lru_cache(maxsize=256)
def page_program(s: Parameterisation, loss: str) -> Callable:
    """The program (p (LANES, P), order, request, fixed, page) → (squares, f) of one page.

    `squares` (LANES, 2, C, 1 + groups, 1 + groups): products of residuals and derivatives with each other, and of these
    times the residuals; `f` (PAGE, C, n): the model at the samples, of the last lane in use. One program for all that a
    fit computes of a model: to trace a model takes as long as to run it over a million samples.
    """
    size = 1 + len(s.free)

    def squared(rows: AnyArray) -> Array:
        return jax.lax.dot_general(rows, rows, (((2,), (2,)), ((0,), (0,))))

    def one_lane(p: Array, f: Array, request: Request, fixed: FixedValues, page: Samples) -> tuple[Array, Array]:
        def add_block(b: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            square, scores, f = carry
            rows, at_samples = _block(s, loss, p, fixed, page, b, request.plain)
            again = jax.lax.cond(request.scores, lambda: scores + squared(rows * rows[:, :1]), lambda: scores)
            return square + squared(rows), again, f.at[b].set(at_samples)

        none = jnp.zeros((s.channels, size, size))
        square, scores, f = jax.lax.fori_loop(0, page.blocks, add_block, (none, none, f))
        return jnp.stack([square, scores]), f

    def program(p: Array, order: Array, request: Request, fixed: FixedValues, page: Samples) -> tuple[Array, Array]:
        def lane(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
            out, f = carry
            squares, f = one_lane(p[order[k]], f, request, fixed, page)
            return out.at[order[k]].set(squares), f

        out = jnp.zeros((LANES, 2, s.channels, size, size))
        f = jnp.zeros((PAGE, s.channels, page.wi.z.shape[1]))
        return jax.lax.fori_loop(0, request.lanes, lane, (out, f))

    return jax.jit(program, compiler_options=options())


def compile_page_program(s: Parameterisation, loss: str, fixed: FixedValues) -> None:
    """Compile the program of a model and a loss, before there are readings."""
    n, c = block_of(s.channels), s.channels
    up = Direction(*(np.full((PAGE, n), e) for e in NORMAL))
    none = np.zeros((PAGE, n, c))
    blocks = block_rules(None, PAGE)
    page = Samples(up, up, none, none, np.asarray(0), np.asarray(1.0), blocks, disc_rules(POINTS))
    request = Request(np.asarray(0, np.int32), np.asarray(False), np.asarray(False))
    program = page_program(s, loss)
    program(np.zeros((LANES, s.size)), np.zeros(LANES, np.int32), request, fixed, page)[0].block_until_ready()


def summed(s: Parameterisation, squares: Float[np.ndarray, "S C g g"]) -> NormalEquations:
    """The normal equations over all free numbers, from channel-wise products of residuals and derivatives."""
    shared, each = (1 + np.flatnonzero([g.per_channel == kind for g in s.free]) for kind in (False, True))
    total = squares.sum(axis=1)
    gradient = np.asarray(joined(total[:, 0, shared], squares[:, :, 0, each]))
    border, blocks = (squares[:, :, rows[:, None], each] for rows in (shared, each))
    matrix = Arrow(total[:, shared[:, None], shared], border, blocks)
    return NormalEquations(0.5 * total[:, 0, 0], gradient, matrix)


@functools.partial(jax.jit, static_argnums=0)
def sensitivities(
    s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, wi: Direction, wo: Direction
) -> tuple[Float[AnyArray, "n c"], Float[AnyArray, "n g c"]]:
    """(f (n, C), ∂f/∂(free parameter) (n, groups, C)) at directions of shape (n,)."""
    strengths, lobes = _strengths(s, p, fixed), _lobes(s, p, fixed, wi, wo)
    rows = _rows(s, lobes, strengths)
    slopes = jnp.moveaxis(jnp.stack(rows), -1, 0) if rows else jnp.zeros((wi.z.size, 0, s.channels))
    return _sum_of_lobes(lobes, strengths).T, slopes


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Normal equations, score covariance Jᵀ diag(r²) J or None, model values (n, C)."""

    equations: NormalEquations
    scores: Arrow | None
    f: np.ndarray


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
        samples: the same in blocks, as compiled programs take them.
        target_norm_squared: Σ(w T(y c))².
        rules: number of the rule (n,) by which the model is averaged over the discs of each reading, see
            `disc_averages`; None: at their centres.
        lanes: where the readings are laid in blocks; None: one after another.
    """

    parameters: Parameterisation
    fixed: FixedValues
    loss: str
    domains: Domains
    readings: Readings
    weight: np.ndarray
    samples: Samples
    target_norm_squared: float
    rules: np.ndarray | None = None
    lanes: Lanes | None = None

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
        n, channels = readings.f.shape
        lanes = None
        if rules is not None and rules.any():
            lanes = Lanes.of(rules, readings.half_angles, block_of(channels))
        number = n if lanes is None else lanes.source.size
        shape = block_shape(number, channels)
        wi, wo = (_in_blocks(w, lanes, shape) for w in (readings.wi, readings.wo))
        laid = (a if lanes is None else lanes.values(a) for a in (readings.f, weight))
        target, weights = (in_blocks(a, (*shape, channels)) for a in laid)
        cosine = np.abs(wi.z.reshape(-1))[:, None] if uses_cosine(loss) else None
        flat, norm_squared = target.reshape(-1, channels), 0.0
        for some in chunks(number, channels):
            compared = flat[some] if cosine is None else flat[some] * cosine[some]
            flat[some] = transformed(loss, compared, floor)
            norm_squared += float(np.sum((weights.reshape(-1, channels)[some] * flat[some]) ** 2))
        blocks, used = block_rules(lanes, shape[0]), -(-number // shape[1])
        discs = disc_rules(readings.half_angles)
        samples = Samples(wi, wo, target, weights, np.asarray(used), np.asarray(float(floor)), blocks, discs)
        return cls(parameters, fixed, loss, parameters.domains, readings, weight, samples, norm_squared, rules, lanes)

    @property
    def linear(self) -> np.ndarray:
        """Which free numbers (P,) f is proportional to."""
        return self.parameters.linear

    @property
    def order(self) -> np.ndarray:
        """Index, among the free numbers, of each number of the arrow (P,)."""
        return self.parameters.order

    @functools.cached_property
    def _pages(self) -> list[Samples]:
        """The pages in use, each as `Samples` of `PAGE` blocks, without copies."""
        whole, used, parts = self.samples, int(self.samples.blocks), []
        for first in range(0, used, PAGE):
            cut = slice(first, first + PAGE)
            wi, wo = (Direction(*(c[cut] for c in w)) for w in (whole.wi, whole.wo))
            blocks = np.asarray(min(PAGE, used - first))
            rules = BlockRules(*(a[cut] for a in whole.rules))
            parts.append(Samples(wi, wo, whole.target[cut], whole.weight[cut], blocks, whole.floor, rules, whole.discs))
        return parts

    def subset(self, cells: np.ndarray) -> "FitProblem":
        """The same problem on some of the cells."""
        if cells.size == self.weight.shape[0]:
            return self
        return self.averaged(self.rules, cells)

    def averaged(self, rules: np.ndarray | None, cells: np.ndarray | None = None) -> "FitProblem":
        """The same problem with the model averaged by these rules (n,), on some of the cells if given."""
        readings, weight = self.readings, self.weight
        if cells is not None:
            readings, weight, rules = readings.part(cells), weight[cells], None if rules is None else rules[cells]
        floor = float(self.samples.floor)
        return FitProblem.create(self.parameters, self.fixed, self.loss, readings, weight, floor, rules)

    def reweighted(self, weight: np.ndarray) -> "FitProblem":
        """The same problem with other weights (n, C); no array changes its shape, and nothing compiles again."""
        laid = self._in_lanes(weight)
        norm_squared = float(np.sum((laid * self.samples.target) ** 2))
        samples = self.samples._replace(weight=laid)
        return dataclasses.replace(self, weight=weight, samples=samples, target_norm_squared=norm_squared)

    def retargeted(self, target: np.ndarray) -> "FitProblem":
        """The same problem with other targets T(y c), (n, C)."""
        laid = self._in_lanes(target)
        norm_squared = float(np.sum((laid * self.samples.weight) ** 2))
        return dataclasses.replace(self, samples=self.samples._replace(target=laid), target_norm_squared=norm_squared)

    def _in_lanes(self, a: np.ndarray) -> np.ndarray:
        return in_blocks(a if self.lanes is None else self.lanes.values(a), self.samples.weight.shape)

    def linearised(self) -> "FitProblem":
        """The problem of f itself, its residuals to first order in f − y: for `normal_equations(plain=True)`."""
        cosine = self.readings.cos_i[:, None] if uses_cosine(self.loss) else 1.0
        with np.errstate(all="ignore"):
            slope = transform(self.loss, self.readings.f * cosine, self.samples.floor, np)[1]
            return self.retargeted(self.readings.f).reweighted(self.weight * slope * cosine)

    def compared(self, f: np.ndarray) -> np.ndarray:
        """T(f c), (n, C), of values f (n, C) at the readings' directions."""
        return compared(self.readings, self.loss, self.samples.floor, f)

    def residuals(self, f: np.ndarray) -> np.ndarray:
        """w (T(f c) − T(y c)), (n, C), for the model's values f; 0 where there is no reading."""
        return weighted_residuals(self.readings, self.loss, self.samples.floor, self.weight, f)

    def normal_equations(self, p: np.ndarray, active: np.ndarray | None = None, plain: bool = False) -> NormalEquations:
        """The normal equations at up to `LANES` vectors p (S, P); of the active ones, zero for the others.

        `plain`: residuals w(f − target), whatever the loss.
        """
        squares = [page[0] for page in self._run(p, active, plain=plain)]
        return summed(self.parameters, _total(squares, len(p))[:, 0])

    def channel_costs(self, p: np.ndarray) -> np.ndarray:
        """½ Σ r² of each channel, at up to `LANES` vectors p (S, P): (S, C)."""
        return 0.5 * _total([page[0] for page in self._run(p)], len(p))[:, 0, :, 0, 0]

    def evaluate(self, p: np.ndarray, scores: bool = True) -> Evaluation:
        """Normal equations at one p (P,), score covariance [White 1980] and the model's values."""
        f, squares = np.zeros(self.samples.weight.shape), []
        for k, (of_page, f_of_page) in enumerate(self._run(np.asarray(p, float)[None], scores=scores)):
            squares.append(of_page)
            rows = f[k * PAGE : (k + 1) * PAGE]
            rows[:] = np.swapaxes(np.asarray(f_of_page)[: rows.shape[0]], 1, 2)
        total = _total(squares, 1)
        equations, outer = (summed(self.parameters, total[:, k]) for k in range(2))
        f = f.reshape(-1, self.parameters.channels)
        f = f[: self.weight.shape[0]] if self.lanes is None else f[self.lanes.place]
        one, spread = (jax.tree.map(lambda a: a[0], e) for e in (equations, outer.matrix))
        return Evaluation(one, spread if scores else None, f)

    def model_values(self, p: np.ndarray) -> np.ndarray:
        """The model's f (n, C) at the readings' directions, for free numbers p (P,)."""
        return self.evaluate(p, scores=False).f

    def values_at(self, p: np.ndarray, wi: Direction, wo: Direction) -> np.ndarray:
        """The model's f (n, C) at other directions (n,), by the same compiled program."""
        none = np.zeros((wi.z.size, self.parameters.channels))
        readings = Readings(wi, wo, none, none, none > 0)
        return FitProblem.create(self.parameters, self.fixed, self.loss, readings, none, 1.0).model_values(p)

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
        waiting = collections.deque()
        for page in self._pages:
            waiting.append(program(lanes, order, request, self.fixed, page))
            if len(waiting) == UNDER_WAY:
                yield waiting.popleft()
        yield from waiting


def _in_blocks(w: Direction, lanes: Lanes | None, shape: tuple[int, int]) -> Direction:
    components = [np.asarray(c) for c in w]
    if lanes is not None:
        components = [lanes.directions(c, e) for c, e in zip(components, NORMAL, strict=True)]
    return Direction(*(in_blocks(c, shape, e) for c, e in zip(components, NORMAL, strict=True)))


def _total(squares: list[np.ndarray], number: int) -> np.ndarray:
    return np.sum([np.asarray(s) for s in squares], axis=0, dtype=float)[:number]


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
