"""The terms of a model at directions, and their slopes by the free numbers: what f and its derivatives are made of."""

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.core as jax_core
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from gonio.fitting.problem.disc_averages import NodePairs, Samples
from gonio.fitting.problem.parameterisation import FixedValues, Parameterisation
from gonio.fitting.problem.readings import AnyArray
from gonio.models.expression.builder import Frame, assemble
from gonio.models.expression.parser import FACTOR
from gonio.models.geometry.directions import Direction
from gonio.models.kept_jit import kept_jit


class Lobes(NamedTuple):
    """Lobe of each term at strength 1 (T, C, n), and its slope by each shape (shapes, C, n); C may be 1."""

    values: Float[AnyArray, "t c *n"]
    slopes: Float[AnyArray, "s c *n"]


class Strengths(NamedTuple):
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


def strengths_of(s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues) -> Strengths:
    terms, factors = [], [jnp.ones(())] * len(s.free)
    for index in range(len(s.frames)):
        free = [(k, g) for k, g in enumerate(s.free) if g.term == index]
        values = _term_values(s, index, p, fixed)
        factor = values.get(FACTOR, jnp.ones(()))
        amount = next((values[g.path] for _, g in free if g.linear and g.path != FACTOR), jnp.ones(()))
        terms.append(amount * factor)
        for k, g in free:
            factors[k] = amount if g.path == FACTOR else factor if g.linear else amount * factor
    return Strengths(_stacked(terms, (s.channels,)), _stacked(factors, (s.channels,)))


def _stacked(arrays: list[Array], shape: tuple[int, ...]) -> Array:
    return jnp.stack([jnp.broadcast_to(a, shape) for a in arrays]) if arrays else jnp.zeros((0, *shape))


def lobes_at_sample(
    s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, wi: Direction, wo: Direction
) -> Lobes:
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
    return Lobes(_stacked(lobes, width), _stacked(slopes_of, width))


def lobes_of(s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, wi: Direction, wo: Direction) -> Lobes:
    return jax.vmap(lambda i, o: lobes_at_sample(s, p, fixed, i, o), out_axes=-1)(wi, wo)


def averaged_lobes(
    s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, page: Samples, b: Int[AnyArray, ""]
) -> Lobes:
    """The lobes of block b, averaged over its discs: what f is made of linearly, and its slopes, all at once."""
    wi, wo = (Direction(*(c[b] for c in w)) for w in (page.wi, page.wo))
    pairs = NodePairs.of(page.discs, page.rules.rule[b], page.rules.halvings[b], wi, wo)
    # Traced once: models are long, and shapes and loop would each run through them.
    traced, shapes = jax.make_jaxpr(lambda i, o: lobes_of(s, p, fixed, i, o), return_shape=True)(wi, wo)
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


def sum_of_lobes(lobes: Lobes, strengths: Strengths) -> Float[AnyArray, "c n"]:
    each = (lobe * strength[:, None] for lobe, strength in zip(lobes.values, strengths.terms, strict=True))
    return functools.reduce(operator.add, each)


def rows_of(s: Parameterisation, lobes: Lobes, strengths: Strengths) -> list[Float[AnyArray, "c n"]]:
    """∂f/∂(free parameter) of each free parameter."""
    shapes = iter(lobes.slopes)
    order = sorted(range(len(s.free)), key=lambda k: (s.free[k].term, k))
    rows = {k: lobes.values[s.free[k].term] if s.free[k].linear else next(shapes) for k in order}
    return [rows[k] * strengths.factors[k][:, None] for k in range(len(s.free))]


@kept_jit
def sensitivities(
    s: Parameterisation, p: Float[AnyArray, " p"], fixed: FixedValues, wi: Direction, wo: Direction
) -> tuple[Float[AnyArray, "n c"], Float[AnyArray, "n g c"]]:
    """(f (n, C), ∂f/∂(free parameter) (n, groups, C)) at directions of shape (n,)."""
    strengths, lobes = strengths_of(s, p, fixed), lobes_of(s, p, fixed, wi, wo)
    rows = rows_of(s, lobes, strengths)
    slopes = jnp.moveaxis(jnp.stack(rows), -1, 0) if rows else jnp.zeros((wi.z.size, 0, s.channels))
    return sum_of_lobes(lobes, strengths).T, slopes
