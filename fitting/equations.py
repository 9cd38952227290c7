"""Cost, gradient and Gauss–Newton matrix of a fit, streamed over pages and blocks of samples.

The Jacobian is never stored: a block's rows are formed, multiplied and forgotten. A free number that belongs to one
channel touches only that channel's residuals, so that each channel adds a small square matrix of (free parameters a
channel sees)², whatever the number of channels. One compiled program takes a page of samples and up to `LANES` vectors
of free numbers; how many of both are in use is data, so that it serves every table and every stage of a fit.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.losses import transform, uses_cosine
from gonio.fitting.structure import Structure
from gonio.models.building import assemble
from gonio.models.geometry import Direction
from gonio.models.paths import FACTOR

PAGE = 4  # blocks of a page
LANES = 16


def block_of(channels: int) -> int:
    """Samples of a block: what a core's cache holds of their residuals and derivatives."""
    return max(128, 2048 >> max(0, (channels - 1).bit_length() - 2))


class Samples(NamedTuple):
    """Samples of a fit in blocks, padded with weight 0. B blocks, a multiple of `PAGE`, of n samples, C channels."""

    wi: Direction  # components (B, n)
    wo: Direction
    target: Float[Array, "B n C"]  # T(y c)
    weight: Float[Array, "B n C"]
    blocks: Array  # how many of the B are in use
    floor: Array  # of the loss


class Sums(NamedTuple):
    """Sums over all residuals r with the rows J of their Jacobian by the parameters; any leading axes."""

    cost: Float[Array, ""]  # ½ Σ r²
    gradient: Float[Array, " p"]  # Jᵀ r
    matrix: Float[Array, "p p"]  # JᵀJ


class Closing(NamedTuple):
    """What a fit ends with: its sums, Jᵀ diag(r²) J [White 1980], and the model's f at every sample, padding too."""

    total: Sums
    scatter: Float[Array, "p p"]
    f: Float[Array, "N C"]


def _term_values(s: Structure, index: int, p, fixed, linear_one: bool):
    """Values of a term's parameters: held ones, and free ones out of the vector p."""
    values = dict(fixed[index])
    for g in s.groups:
        if g.term == index:
            n = s.channels if g.per_channel else 1
            free = p[g.first : g.first + n]
            values[g.name] = free if g.per_channel else free[0]
            if linear_one and g.linear and g.name != FACTOR:
                values[g.name] = jnp.ones(())
    return values


def _sample_rows(s: Structure, p, fixed, wi: Direction, wo: Direction, slopes: bool = True):
    """(f (C,), ∂f/∂group (groups, C)) of one sample; without `slopes` the rows of linear groups only.

    What f is proportional to (albedo, scale) needs no derivative; one tangent of ones serves all channels of a
    parameter that has a value for each.
    """
    total, rows = jnp.zeros(s.channels), [None] * len(s.groups)
    for index, of in enumerate(s.frames):
        mine = [(k, g) for k, g in enumerate(s.groups) if g.term == index]
        values = _term_values(s, index, p, fixed, linear_one=True)
        actual = _term_values(s, index, p, fixed, linear_one=False)
        factor = values.pop(FACTOR, None)
        actual.pop(FACTOR, None)
        proportional = [g for _, g in mine if g.linear and g.name != FACTOR]
        amount = actual[proportional[0].name] if proportional else jnp.ones(())
        moving = [(k, g) for k, g in mine if not g.linear]

        def lobe(shapes, values=values, of=of):
            return assemble(of, {**values, **shapes}).f(wi, wo)

        shapes = {g.name: values[g.name] for _, g in moving}
        base = lobe(shapes)
        strength = amount if factor is None else amount * factor
        total = total + strength * base
        for k, g in mine:
            if g.name == FACTOR:
                rows[k] = amount * base
            elif g.linear:
                rows[k] = base if factor is None else factor * base
        if moving and slopes:
            directions = {g.name: jnp.eye(len(moving))[j] for j, (_, g) in enumerate(moving)}

            def along(tangent, shapes=shapes, lobe=lobe):
                spread = {n: jnp.broadcast_to(tangent[n], jnp.shape(v)) for n, v in shapes.items()}
                return jax.jvp(lobe, (shapes,), (spread,))[1]

            sloping = jax.vmap(along)(directions)
            for j, (k, _) in enumerate(moving):
                rows[k] = strength * sloping[j]
    stacked = [jnp.broadcast_to(r, (s.channels,)) for r in rows if r is not None]
    return total, (jnp.stack(stacked) if stacked else jnp.zeros((0, s.channels)))


def _block(s: Structure, loss: str, p, fixed, data: Samples, b):
    """(residuals, their derivatives by group) of block b: shapes (n, C), (n, groups, C)."""
    wi, wo = (Direction(*(c[b] for c in w)) for w in (data.wi, data.wo))
    target, weight = data.target[b], data.weight[b]
    f, rows = jax.vmap(lambda a, b: _sample_rows(s, p, fixed, a, b))(wi, wo)
    c = wi.z[:, None] if uses_cosine(loss) else jnp.ones_like(wi.z)[:, None]
    value, slope = transform(loss, f * c, data.floor)
    used = weight > 0
    residual = jnp.where(used, weight * (value - target), 0.0)
    return residual, jnp.where(used, weight * slope * c, 0.0)[:, None, :] * rows


@functools.lru_cache(maxsize=256)
def _sums_program(s: Structure, loss: str):
    """Of one page: (cost, Jᵀr (groups, C), JᵀJ and Jᵀdiag(r²)J (groups, groups, C)), raveled, for each lane in use."""
    groups = len(s.groups)

    def one_lane(p, scattered, fixed, page: Samples):
        def add_block(b, carry):
            cost, row, square, scatter = carry
            r, jac = _block(s, loss, p, fixed, page, b)
            row = row + jnp.einsum("nkc,nc->kc", jac, r)

            def with_scatter():
                weighted = jac * r[:, None, :]
                return scatter + jnp.einsum("nkc,nlc->klc", weighted, weighted)

            scatter = jax.lax.cond(scattered, with_scatter, lambda: scatter)
            return cost + 0.5 * jnp.sum(r * r), row, square + jnp.einsum("nkc,nlc->klc", jac, jac), scatter

        squares = jnp.zeros((groups, groups, s.channels))
        start = (jnp.zeros(()), jnp.zeros((groups, s.channels)), squares, squares)
        return jnp.concatenate([jnp.ravel(a) for a in jax.lax.fori_loop(0, page.blocks, add_block, start)])

    @jax.jit
    def program(p, active, scattered, fixed, page: Samples):
        def lane(k, out):
            return jax.lax.cond(active[k], lambda: out.at[k].set(one_lane(p[k], scattered, fixed, page)), lambda: out)

        width = 1 + (groups + 2 * groups * groups) * s.channels
        return jax.lax.fori_loop(0, LANES, lane, jnp.zeros((LANES, width)))

    return program


@functools.lru_cache(maxsize=256)
def _values_program(s: Structure):
    """Of one page: f (PAGE, n, C) and ∂f/∂group (PAGE, n, linear groups, C)."""

    @jax.jit
    def program(p, fixed, wi: Direction, wo: Direction, blocks):
        one = jax.vmap(lambda a, b: _sample_rows(s, p, fixed, a, b, slopes=False))
        held = jax.eval_shape(one, *(Direction(*(c[0] for c in w)) for w in (wi, wo)))

        def block(b, out):
            found = one(*(Direction(*(c[b] for c in w)) for w in (wi, wo)))
            return tuple(o.at[b].set(v) for o, v in zip(out, found, strict=True))

        return jax.lax.fori_loop(0, blocks, block, tuple(jnp.zeros((PAGE, *h.shape), h.dtype) for h in held))

    return program


def _pages(data: Samples):
    """The pages in use, each as `Samples` of `PAGE` blocks, without copies."""
    whole = jax.tree.map(np.asarray, data)
    used = int(whole.blocks)
    for first in range(0, used, PAGE):
        cut = slice(first, first + PAGE)
        wi, wo = (Direction(*(c[cut] for c in w)) for w in (whole.wi, whole.wo))
        blocks = np.asarray(min(PAGE, used - first))
        yield Samples(wi, wo, whole.target[cut], whole.weight[cut], blocks, whole.floor)


def _spread(s: Structure, square: np.ndarray) -> np.ndarray:
    """Channel-wise matrices (S, groups, groups, C) laid out over all free numbers, (S, P, P)."""
    matrix = np.zeros((square.shape[0], s.size, s.size))
    for c in range(s.channels):
        at = s.columns(c)
        matrix[:, at[:, None], at[None, :]] += square[..., c]
    return matrix


def sums(
    s: Structure, loss: str, p: np.ndarray, fixed, data: Samples, active: np.ndarray | None = None, scattered=False
) -> tuple[Sums, np.ndarray]:
    """(sums, Jᵀ diag(r²) J (S, P, P) where `scattered`) at up to `LANES` vectors p (S, P); of the active ones, or 0."""
    program, number, groups = _sums_program(s, loss), len(p), len(s.groups)
    lanes, use = np.zeros((LANES, s.size)), np.zeros(LANES, bool)
    lanes[:number], use[:number] = p, True if active is None else active
    found = [program(lanes, use, np.asarray(scattered), fixed, page) for page in _pages(data)]
    total = np.sum([np.asarray(f) for f in found], axis=0)[:number]
    ends = np.cumsum([1, groups * s.channels, groups * groups * s.channels])
    cost, row, square, scatter = np.split(total, ends, axis=1)
    square, scatter = (a.reshape(number, groups, groups, s.channels) for a in (square, scatter))
    row = row.reshape(number, groups, s.channels)
    gradient = np.zeros((number, s.size))
    for c in range(s.channels):
        gradient[:, s.columns(c)] += row[..., c]
    return Sums(cost[:, 0], gradient, _spread(s, square)), _spread(s, scatter) if scattered else None


def values(s: Structure, p: np.ndarray, fixed, data: Samples) -> np.ndarray:
    """The model's f at every sample, (N, C) with the padding of the last page."""
    program, p = _values_program(s), np.asarray(p, float)
    blocks, block, channels = data.weight.shape
    found = np.zeros((blocks, block, channels))
    for k, page in enumerate(_pages(data)):
        found[k * PAGE : (k + 1) * PAGE] = program(p, fixed, page.wi, page.wo, page.blocks)[0]
    return found.reshape(-1, channels)


def linear_rows(s: Structure, p: np.ndarray, fixed, data: Samples) -> tuple[np.ndarray, np.ndarray]:
    """(f (N, C), ∂f/∂group (N, linear groups, C)) at every sample, with the padding of the last page: for starts."""
    program, p = _values_program(s), np.asarray(p, float)
    found = [program(p, fixed, page.wi, page.wo, page.blocks) for page in _pages(data)]
    flat = [[np.asarray(a).reshape(a.shape[0] * a.shape[1], *a.shape[2:]) for a in page] for page in found]
    return tuple(np.concatenate(part) for part in zip(*flat, strict=True))


def closing(s: Structure, loss: str, p: np.ndarray, fixed, data: Samples) -> Closing:
    """The sums at p (P,) with the middle of the heteroscedasticity-consistent covariance, and the model."""
    p = np.asarray(p, float)
    total, scatter = sums(s, loss, p[None], fixed, data, scattered=True)
    return Closing(Sums(*(a[0] for a in total)), scatter[0], values(s, p, fixed, data))


@functools.partial(jax.jit, static_argnums=0)
def lobes_at(s: Structure, p, fixed, wi: Direction, wo: Direction):
    """(f (n, C), ∂f/∂group (n, groups, C)) at directions of shape (n,)."""
    return jax.vmap(lambda a, b: _sample_rows(s, p, fixed, a, b))(wi, wo)
