"""What a formula does below the horizon: nothing, and without poisoning a gradient."""

import jax.numpy as jnp
from jaxtyping import Array

from gonio.models.geometry import NORMAL, Direction


def above(wi: Direction, wo: Direction) -> tuple[Array, Direction, Direction]:
    """(whether both are above the horizon, wi, wo), with the normal in place of both where they are not.

    A formula evaluated there and then masked with the first value has no NaN in its gradient.
    """
    both = (wi.z > 0) & (wo.z > 0)
    moved = [Direction(*(jnp.where(both, c, e) for c, e in zip(w, NORMAL, strict=True))) for w in (wi, wo)]
    return both, *moved
