"""Cost, gradient and Gauss–Newton matrix of a fit, streamed over blocks of samples.

The Jacobian is never stored: a block's rows are formed, multiplied and forgotten. A free number that belongs to one
channel touches only that channel's residuals, so that each channel adds a small square matrix of (free parameters a
channel sees)², whatever the number of channels.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.losses import transform, uses_cosine
from gonio.fitting.structure import Structure
from gonio.models.building import assemble
from gonio.models.geometry import Direction
from gonio.models.paths import FACTOR

BLOCK = 2048


class Samples(NamedTuple):
    """Samples of a fit in blocks, padded with weight 0. B blocks of n samples, C channels."""

    wi: Direction  # components (B, n)
    wo: Direction
    target: Float[Array, "B n C"]  # T(y c)
    weight: Float[Array, "B n C"]
    blocks: Array  # how many of the B are in use
    floor: Array  # of the loss


class Sums(NamedTuple):
    """Sums over all residuals r with the rows J of their Jacobian by the parameters themselves."""

    cost: Float[Array, ""]  # ½ Σ r²
    gradient: Float[Array, " p"]  # Jᵀ r
    matrix: Float[Array, "p p"]  # JᵀJ, or Jᵀ diag(r²) J for `scatter`


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


def _sample_rows(s: Structure, p, fixed, wi: Direction, wo: Direction):
    """(f (C,), ∂f/∂group (groups, C)) of one sample.

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
        if moving:
            directions = {g.name: jnp.eye(len(moving))[j] for j, (_, g) in enumerate(moving)}

            def along(tangent, shapes=shapes, lobe=lobe):
                spread = {n: jnp.broadcast_to(tangent[n], jnp.shape(v)) for n, v in shapes.items()}
                return jax.jvp(lobe, (shapes,), (spread,))[1]

            slopes = jax.vmap(along)(directions)
            for j, (k, _) in enumerate(moving):
                rows[k] = strength * slopes[j]
    stacked = [jnp.broadcast_to(r, (s.channels,)) for r in rows]
    return total, (jnp.stack(stacked) if stacked else jnp.zeros((0, s.channels)))


def _block(s: Structure, loss: str, p, fixed, data: Samples, b):
    """(f, residuals, their derivatives by group) of block b: shapes (n, C), (n, C), (n, groups, C)."""
    wi, wo = (Direction(*(c[b] for c in w)) for w in (data.wi, data.wo))
    target, weight = data.target[b], data.weight[b]
    f, rows = jax.vmap(lambda a, b: _sample_rows(s, p, fixed, a, b))(wi, wo)
    c = wi.z[:, None] if uses_cosine(loss) else jnp.ones_like(wi.z)[:, None]
    value, slope = transform(loss, f * c, data.floor)
    used = weight > 0
    residual = jnp.where(used, weight * (value - target), 0.0)
    return f, residual, jnp.where(used, weight * slope * c, 0.0)[:, None, :] * rows


def _spread(s: Structure, square, row):
    """A channel-wise (groups, groups, C) matrix and (groups, C) vector laid out over all free numbers."""
    matrix, vector = jnp.zeros((s.size, s.size)), jnp.zeros(s.size)
    for c in range(s.channels):
        at = s.columns(c)
        matrix = matrix.at[np.ix_(at, at)].add(square[:, :, c])
        vector = vector.at[at].add(row[:, c])
    return matrix, vector


def sums(s: Structure, loss: str, p, fixed, data: Samples) -> Sums:
    """Cost, gradient and matrix at the free numbers p, shape (P,), over all blocks in use."""
    groups = len(s.groups)

    def add_block(b, carry):
        cost, row, square = carry
        _, r, jac = _block(s, loss, p, fixed, data, b)
        row = row + jnp.einsum("nkc,nc->kc", jac, r)
        return cost + 0.5 * jnp.sum(r * r), row, square + jnp.einsum("nkc,nlc->klc", jac, jac)

    start = (jnp.zeros(()), jnp.zeros((groups, s.channels)), jnp.zeros((groups, groups, s.channels)))
    cost, row, square = jax.lax.fori_loop(0, data.blocks, add_block, start)
    matrix, vector = _spread(s, square, row)
    return Sums(cost, vector, matrix)


class Closing(NamedTuple):
    """What a fit ends with: its sums, Jᵀ diag(r²) J [White 1980], and the model's f at every sample."""

    total: Sums
    scatter: Float[Array, "p p"]
    f: Float[Array, "B n C"]


@eqx.filter_jit
def closing(s: Structure, loss: str, p, fixed, data: Samples) -> Closing:
    """The sums at p once more, with the middle of the heteroscedasticity-consistent covariance and the model."""
    groups = len(s.groups)

    def add_block(carry, b):
        cost, row, square, scatter = carry
        f, r, jac = _block(s, loss, p, fixed, data, b)
        weighted = jac * r[:, None, :]
        row = row + jnp.sum(weighted, 0)
        square = square + jnp.einsum("nkc,nlc->klc", jac, jac)
        scatter = scatter + jnp.einsum("nkc,nlc->klc", weighted, weighted)
        return (cost + 0.5 * jnp.sum(r * r), row, square, scatter), f

    squares = jnp.zeros((groups, groups, s.channels))
    start = (jnp.zeros(()), jnp.zeros((groups, s.channels)), squares, squares)
    (cost, row, square, scatter), f = jax.lax.scan(add_block, start, jnp.arange(data.weight.shape[0]))
    matrix, vector = _spread(s, square, row)
    return Closing(Sums(cost, vector, matrix), _spread(s, scatter, row)[0], f)


@eqx.filter_jit
def lobes_at(s: Structure, p, fixed, wi: Direction, wo: Direction):
    """(f (n, C), ∂f/∂group (n, groups, C)) at directions of shape (n,): for starts."""
    return jax.vmap(lambda a, b: _sample_rows(s, p, fixed, a, b))(wi, wo)
