"""Where pairs of directions lie in a kind of layout: one compiled program for each kind, whatever their number."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.layouts.base import Layout
from gonio.models.geometry.directions import Direction
from gonio.models.kept_jit import kept_jit

BLOCK = 8192


def grid_coordinates(kind: type[Layout], wi: Direction, wo: Direction) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """(angle on each axis, whether the layout can hold it), (n,) each, of pairs of directions (n,), radians.

    In blocks of one size, so that one program serves any number of pairs.
    """
    parts = [np.asarray(c, float) for c in (*wi, *wo)]
    n, made = parts[0].size, []
    for start in range(0, max(n, 1), BLOCK):
        block = [np.resize(c[start : start + BLOCK], BLOCK) if n else np.zeros(BLOCK) for c in parts]
        made.append(_coordinates(kind, Direction(*block[:3]), Direction(*block[3:])))
    angles = {name: np.concatenate([np.asarray(x[name]) for x, _ in made])[:n] for name in made[0][0]}
    return angles, np.concatenate([np.asarray(c) for _, c in made])[:n]


@kept_jit
def _coordinates(kind: type[Layout], wi: Direction, wo: Direction) -> tuple[dict[str, Any], Any]:
    def one(i: Direction, o: Direction) -> tuple[dict[str, Any], Any]:
        return kind.coordinates(i, o), jnp.asarray(kind.covers(i, o))

    return jax.vmap(one)(wi, wo)
