"""The horizon: which pairs of directions a surface scatters between, decided here with one threshold."""

import functools
import operator

import jax.numpy as jnp
from jaxtyping import Array, Bool

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.half_vector import stands_for
from gonio.models.geometry.sides import EVERYWHERE as EVERYWHERE
from gonio.models.geometry.sides import HORIZON as HORIZON
from gonio.models.geometry.sides import TWO_SIDED as TWO_SIDED
from gonio.models.geometry.sides import Hemispheres as Hemispheres


def above_horizon(wi: Direction, wo: Direction) -> Bool[Array, "..."]:
    """Whether both directions are above the horizon."""
    # One comparison: XLA would evaluate two, as a logical array that several formulas use, in a loop of their own
    return jnp.minimum(wi.z, wo.z) > HORIZON


def guarded_pair(
    hemispheres: Hemispheres, wi: Direction, wo: Direction
) -> tuple[Bool[Array, "..."], Direction, Direction]:
    """(mask, wi, wo): whether a surface scatters between two directions, and the pair with which its formula is safe.

    What is refused is replaced by the normals of the two sides: no formula divides by 0 there, no gradient is NaN, and
    arctangents and logarithms end early.
    """
    if hemispheres == Hemispheres.REFLECTION:
        # Each by its own cosine: along the rows of a grid, one direction is then selected once
        pair = _selected(wi.z > HORIZON, wi, 1.0), _selected(wo.z > HORIZON, wo, 1.0)
        stands_for(pair, wi, wo)
        return above_horizon(wi, wo), *pair
    mask = jnp.minimum(jnp.abs(wi.z), jnp.abs(wo.z)) > HORIZON
    if hemispheres != EVERYWHERE:
        front_i, front_o = wi.z > 0, wo.z > 0
        cases = {
            Hemispheres.REFLECTION: front_i & front_o,
            Hemispheres.TRANSMISSION: front_i ^ front_o,
            Hemispheres.BACK: ~(front_i | front_o),
        }
        mask = mask & functools.reduce(operator.or_, (case for one, case in cases.items() if one in hemispheres))
    side = -1.0 if hemispheres == Hemispheres.TRANSMISSION else 1.0
    pair = _selected(mask, wi, 1.0), _selected(mask, wo, side)
    stands_for(pair, wi, wo)
    return mask, *pair


def lit(hemispheres: Hemispheres, wi: Direction) -> tuple[Bool[Array, ""] | bool, Direction]:
    """(whether a surface scatters light from wi at all, wi or, where it does not, the normal)."""
    if hemispheres & ~Hemispheres.REFLECTION:
        return True, wi
    front = wi.z > 0
    return front, _selected(front, wi, 1.0)


def same_side(wi: Direction, wo: Direction) -> Bool[Array, "..."]:
    """Whether both directions are in front, or both behind: reflection; else transmission."""
    return (wi.z > 0) == (wo.z > 0)


def turned_over(w: Direction, side: Scalar) -> Direction:
    """A direction as seen from the front (side 1) or, mirrored at the surface, from behind (side -1)."""
    return Direction(w.x, w.y, side * w.z)


def _selected(mask: Bool[Array, "..."], w: Direction, side: float) -> Direction:
    return Direction(*(jnp.where(mask, c, n) for c, n in zip(w, (0.0, 0.0, side), strict=True)))
