"""The horizon: which pairs of directions a surface scatters between, decided here with one threshold."""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from gonio.models.geometry.directions import Direction
from gonio.models.geometry.sides import HORIZON as HORIZON
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
        return above_horizon(wi, wo), _selected(wi.z > HORIZON, wi, 1.0), _selected(wo.z > HORIZON, wo, 1.0)
    mask, side = jnp.minimum(jnp.abs(wi.z), jnp.abs(wo.z)) > HORIZON, 1.0
    if hemispheres == Hemispheres.TRANSMISSION:
        mask, side = mask & (wi.z * wo.z < 0), -1.0
    else:
        mask = mask & ((wi.z > 0) | (wo.z > 0))
    return mask, _selected(mask, wi, 1.0), _selected(mask, wo, side)


def _selected(mask: Bool[Array, "..."], w: Direction, side: float) -> Direction:
    return Direction(*(jnp.where(mask, c, n) for c, n in zip(w, (0.0, 0.0, side), strict=True)))
