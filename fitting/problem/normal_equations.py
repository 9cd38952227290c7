"""Cost, gradient and Gauss–Newton matrix of a fit, streamed over pages and blocks of samples.

The Jacobian is never stored: a block's rows are formed, multiplied and forgotten. A free number that belongs to one
channel touches only that channel's residuals, so that each channel adds a small square matrix of (free parameters a
channel sees)², whatever the number of channels. One compiled program takes a page of samples and up to `LANES` vectors
of free numbers; how many of both are in use is data, so that it serves every table and every stage of a fit.
"""

import collections
import functools
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.problem.blocks import LANES, PAGE, Samples, block_of, pages
from gonio.fitting.problem.losses import transform, uses_cosine
from gonio.fitting.problem.parameterisation import Structure
from gonio.models.compiling import options
from gonio.models.expression.builder import assemble
from gonio.models.expression.paths import FACTOR
from gonio.models.geometry.directions import NORMAL, Direction

UNDER_WAY = 8  # pages whose results are waited for at a time


class Sums(NamedTuple):
    """Sums over all residuals r with the rows J of their Jacobian by the parameters; any leading axes."""

    cost: Float[Array, ""]  # ½ Σ r²
    gradient: Float[Array, " p"]  # Jᵀ r
    matrix: Float[Array, "p p"]  # JᵀJ


class _Asked(NamedTuple):
    """What a program is asked for: how many lanes; the scatter too; of f itself, in place of its loss."""

    lanes: Array
    scattered: Array
    plain: Array


class Closing(NamedTuple):
    """What a fit ends with: its sums, Jᵀ diag(r²) J [White 1980], and the model's f at every sample, padding too."""

    total: Sums
    scatter: Float[Array, "p p"]
    f: Float[Array, "N C"]


def _term_values(s: Structure, index: int, p, fixed):
    """Values of a term's parameters: held ones, and free ones out of the vector p."""
    values = dict(fixed[index])
    for g in s.groups:
        if g.term == index:
            free = p[g.first : g.first + (s.channels if g.per_channel else 1)]
            values[g.name] = free if g.per_channel else free[0]
    return values


def _strengths(s: Structure, p, fixed):
    """(strength of each term (T, C), what ∂f/∂group is a multiple of its lobe or slope by (groups, C))."""
    strengths, factors = [], [None] * len(s.groups)
    for index in range(len(s.frames)):
        mine = [(k, g) for k, g in enumerate(s.groups) if g.term == index]
        values = _term_values(s, index, p, fixed)
        factor = values.get(FACTOR, jnp.ones(()))
        amount = next((values[g.name] for _, g in mine if g.linear and g.name != FACTOR), jnp.ones(()))
        strengths.append(amount * factor)
        for k, g in mine:
            factors[k] = amount if g.name == FACTOR else factor if g.linear else amount * factor
    spread = [[jnp.broadcast_to(v, (s.channels,)) for v in each] for each in (strengths, factors)]
    return tuple(jnp.stack(each) if each else jnp.zeros((0, s.channels)) for each in spread)


def _sample_lobes(s: Structure, p, fixed, wi: Direction, wo: Direction):
    """(lobe of each term at strength 1, its slope by each shape) at one sample: (T, C) and (shapes, C), or C = 1.

    What f is proportional to (albedo, scale) needs no derivative; one tangent of ones serves all channels of a
    parameter that has a value for each. C is 1 where no shape differs between channels.
    """
    lobes, slopes_of = [], []
    for index, of in enumerate(s.frames):
        mine = [g for g in s.groups if g.term == index]
        values = _term_values(s, index, p, fixed)
        values.pop(FACTOR, None)
        values |= {g.name: jnp.ones(()) for g in mine if g.linear and g.name != FACTOR}

        def lobe(shapes, values=values, of=of):
            return assemble(of, {**values, **shapes}).f(wi, wo)

        shapes = {g.name: values[g.name] for g in mine if not g.linear}
        if not shapes:
            lobes.append(lobe(shapes))
            continue

        def along(tangent, shapes=shapes, lobe=lobe):
            spread = {n: jnp.broadcast_to(tangent[n], jnp.shape(v)) for n, v in shapes.items()}
            return jax.jvp(lobe, (shapes,), (spread,))

        one_each = {name: jnp.eye(len(shapes))[k] for k, name in enumerate(shapes)}
        value, slopes = jax.vmap(along, out_axes=(None, 0))(one_each)
        lobes.append(value)
        slopes_of += list(slopes)
    width = (max(jnp.size(a) for a in [*lobes, *slopes_of]),)
    stacked = [[jnp.broadcast_to(a, width) for a in each] for each in (lobes, slopes_of)]
    return tuple(jnp.stack(each) if each else jnp.zeros((0, *width)) for each in stacked)


def _rows(s: Structure, lobes, slopes, factors):
    """∂f/∂group (groups, C, n) from lobes (T, C or 1, n), slopes (shapes, C or 1, n) and factors (groups, C)."""
    shapes = iter(slopes)
    order = sorted(range(len(s.groups)), key=lambda k: (s.groups[k].term, k))
    rows = {k: lobes[s.groups[k].term] if s.groups[k].linear else next(shapes) for k in order}
    return [rows[k] * factors[k][:, None] for k in range(len(s.groups))]


def _computed(always, function):
    """The function's values, written to memory: a branch that is always taken, which XLA cannot know.

    XLA would otherwise compute lobes again for every channel, and losses for every derivative that uses them.
    """
    # Traced once: models are long, and shapes and branch would each run through them.
    traced, shapes = jax.make_jaxpr(function, return_shape=True)()
    leaves, tree = jax.tree.flatten(shapes)
    found = jax.lax.cond(
        always,
        lambda: jax.core.eval_jaxpr(traced.jaxpr, traced.consts),
        lambda: [jnp.zeros(h.shape, h.dtype) for h in leaves],
    )
    return jax.tree.unflatten(tree, found)


def _block(s: Structure, loss: str, p, fixed, data: Samples, b, plain):
    """(residuals and under them their derivatives (C, 1 + groups, n), the model's f (C, n)) of block b."""
    wi, wo = (Direction(*(c[b] for c in w)) for w in (data.wi, data.wo))
    always = b < data.blocks
    strengths, factors = _strengths(s, p, fixed)
    at_samples = jax.vmap(lambda i, o: _sample_lobes(s, p, fixed, i, o), out_axes=-1)
    lobes, slopes = _computed(always, lambda: at_samples(wi, wo))

    def compared():
        f = sum(lobe * strength[:, None] for lobe, strength in zip(lobes, strengths, strict=True))
        weight = data.weight[b].T
        used = weight > 0
        c = wi.z[None, :] if uses_cosine(loss) else jnp.ones_like(wi.z)[None, :]
        value, slope = transform(loss, f * c, data.floor)
        value, slope = jnp.where(plain, f, value), jnp.where(plain, 1.0, slope * c)
        residual = jnp.where(used, weight * (value - data.target[b].T), 0.0)
        return residual, jnp.where(used, weight * slope, 0.0), f

    residual, by_f, f = _computed(always, compared)

    def rows():
        return jnp.stack([residual, *(row * by_f for row in _rows(s, lobes, slopes, factors))], axis=1)

    return _computed(always, rows), f


@functools.lru_cache(maxsize=256)
def _program(s: Structure, loss: str):
    """Of one page: the products of residuals and derivatives with each other, and of these times the residuals, (2, C,
    1 + groups, 1 + groups), for the lanes in use, and the model's f (PAGE, C, n) of the last of them.

    One program for all that a fit asks of a model: to trace a model takes as long as to run it over a million samples.
    """
    size = 1 + len(s.groups)

    def squared(rows):
        return jax.lax.dot_general(rows, rows, (((2,), (2,)), ((0,), (0,))))

    def one_lane(p, f, asked: _Asked, fixed, page: Samples):
        def add_block(b, carry):
            square, scatter, f = carry
            rows, at_samples = _block(s, loss, p, fixed, page, b, asked.plain)
            again = jax.lax.cond(asked.scattered, lambda: scatter + squared(rows * rows[:, :1]), lambda: scatter)
            return square + squared(rows), again, f.at[b].set(at_samples)

        none = jnp.zeros((s.channels, size, size))
        square, scatter, f = jax.lax.fori_loop(0, page.blocks, add_block, (none, none, f))
        return jnp.stack([square, scatter]), f

    def program(p, order, asked: _Asked, fixed, page: Samples):
        def lane(k, carry):
            out, f = carry
            found, f = one_lane(p[order[k]], f, asked, fixed, page)
            return out.at[order[k]].set(found), f

        out = jnp.zeros((LANES, 2, s.channels, size, size))
        f = jnp.zeros((PAGE, s.channels, page.wi.z.shape[1]))
        return jax.lax.fori_loop(0, asked.lanes, lane, (out, f))

    return jax.jit(program, compiler_options=options())


def _spread(s: Structure, square: np.ndarray) -> np.ndarray:
    """Channel-wise matrices (S, C, 1 + groups, 1 + groups), the residuals' row left out, over all free numbers."""
    matrix = np.zeros((square.shape[0], s.size, s.size))
    for c in range(s.channels):
        at = s.columns(c)
        matrix[:, at[:, None], at[None, :]] += square[:, c, 1:, 1:]
    return matrix


def _run(s: Structure, loss: str, p: np.ndarray, fixed, data, active=None, scattered=False, plain=False) -> Iterator:
    """What the program gives for each page in turn; a few pages are under way at a time, on several processors."""
    program, number = _program(s, loss), len(p)
    lanes, order = np.zeros((LANES, s.size)), np.zeros(LANES, np.int32)
    lanes[:number] = p
    use = np.flatnonzero(np.broadcast_to(True if active is None else active, (number,)))
    order[: use.size] = use
    asked = _Asked(np.asarray(use.size, np.int32), np.asarray(scattered), np.asarray(plain))
    waiting = collections.deque()
    for page in pages(data):
        waiting.append(program(lanes, order, asked, fixed, page))
        if len(waiting) == UNDER_WAY:
            yield waiting.popleft()
    yield from waiting


def prepare(s: Structure, loss: str, fixed) -> None:
    """Have the program of a model and a loss compiled, before there are readings."""
    n, c = block_of(s.channels), s.channels
    up = Direction(*(np.full((PAGE, n), e) for e in NORMAL))
    none = np.zeros((PAGE, n, c))
    page = Samples(up, up, none, none, np.asarray(0), np.asarray(1.0))
    for found, _ in _run(s, loss, np.zeros((0, s.size)), fixed, [page]):
        found.block_until_ready()


def sums(
    s: Structure,
    loss: str,
    p: np.ndarray,
    fixed,
    data: Samples | list[Samples],
    active: np.ndarray | None = None,
    scattered: bool = False,
    plain: bool = False,
) -> tuple[Sums, np.ndarray]:
    """(sums, Jᵀ diag(r²) J (S, P, P) where `scattered`) at up to `LANES` vectors p (S, P); of the active ones, or 0.

    `plain`: residuals w(f − target), whatever the loss.
    """
    found = [page[0] for page in _run(s, loss, p, fixed, data, active, scattered, plain)]
    return _summed(s, len(p), found, scattered)


def _summed(s: Structure, number: int, found: list, scattered: bool) -> tuple[Sums, np.ndarray]:
    total = np.sum([np.asarray(f) for f in found], axis=0, dtype=float)[:number]
    square, scatter = total[:, 0], total[:, 1]
    gradient = np.zeros((number, s.size))
    for c in range(s.channels):
        gradient[:, s.columns(c)] += square[:, c, 0, 1:]
    cost = 0.5 * np.sum(square[:, :, 0, 0], axis=1)
    return Sums(cost, gradient, _spread(s, square)), _spread(s, scatter) if scattered else None


def values(s: Structure, loss: str, p: np.ndarray, fixed, data: Samples) -> np.ndarray:
    """The model's f at every sample, (N, C) with the padding of the last page."""
    return closing(s, loss, p, fixed, data, scattered=False).f


def closing(s: Structure, loss: str, p: np.ndarray, fixed, data: Samples, scattered: bool = True) -> Closing:
    """The sums at p (P,) with the middle of the heteroscedasticity-consistent covariance, and the model."""
    f, found = np.zeros(data.weight.shape), []
    for k, (sums_of_page, f_of_page) in enumerate(
        _run(s, loss, np.asarray(p, float)[None], fixed, data, None, scattered)
    ):
        found.append(sums_of_page)
        at = f[k * PAGE : (k + 1) * PAGE]
        at[:] = np.swapaxes(np.asarray(f_of_page)[: at.shape[0]], 1, 2)
    total, scatter = _summed(s, 1, found, scattered)
    return Closing(Sums(*(a[0] for a in total)), scatter[0] if scattered else None, f.reshape(-1, s.channels))


@functools.partial(jax.jit, static_argnums=0)
def lobes_at(s: Structure, p, fixed, wi: Direction, wo: Direction):
    """(f (n, C), ∂f/∂group (n, groups, C)) at directions of shape (n,)."""
    strengths, factors = _strengths(s, p, fixed)
    found = jax.vmap(lambda i, o: _sample_lobes(s, p, fixed, i, o), out_axes=-1)(wi, wo)
    f = sum(lobe * strength[:, None] for lobe, strength in zip(found[0], strengths, strict=True))
    rows = _rows(s, *found, factors)
    return f.T, jnp.moveaxis(jnp.stack(rows), -1, 0) if rows else jnp.zeros((wi.z.size, 0, s.channels))
