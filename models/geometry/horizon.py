"""What a formula does below the horizon: nothing, and without poisoning a gradient."""

import jax.numpy as jnp
from jaxtyping import Array

from gonio.models.geometry.directions import NORMAL, Direction


def above(wi: Direction, wo: Direction) -> tuple[Array, Direction, Direction]:
    """(whether both are above the horizon, wi, wo), with the normal in place of both where they are not.

    A formula evaluated there and then masked with the first value has no NaN in its gradient.
    """
    both = is_above(wi, wo)
    moved = [Direction(*(jnp.where(both, c, e) for c, e in zip(w, NORMAL, strict=True))) for w in (wi, wo)]
    return both, *moved


def is_above(wi: Direction, wo: Direction, horizon: float = 0.0) -> Array:
    """Whether both cosines are more than `horizon`."""
    # One comparison: XLA would evaluate two, as a logical array that several formulas use, in a loop of their own
    return jnp.minimum(wi.z, wo.z) > horizon


def raised(wi: Direction, wo: Direction) -> tuple[Array, Direction, Direction]:
    """(1 where both are above the horizon, else 0; wi, wo), with cosine 1 in place of one that is not positive.

    For formulas that are finite for vectors of any length up to √2: a factor, and two selections instead of seven, keep
    the loops that XLA makes of them free of branches.
    """
    shown = jnp.where(is_above(wi, wo), 1.0, jnp.zeros_like(wi.z))
    return shown, *(Direction(w.x, w.y, jnp.where(w.z > 0, w.z, 1.0)) for w in (wi, wo))
