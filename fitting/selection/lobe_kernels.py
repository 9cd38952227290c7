"""Values of a kind of lobe and their derivatives by its shapes, at many sets of shapes: by loops, or by XLA."""

import functools
import threading
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import Rows, SumsProgram
from gonio.models.expression.builder import Frame, assemble, prepared
from gonio.models.fingerprint import program_name
from gonio.models.geometry.directions import NORMAL, Direction
from gonio.models.kept_jit import kept_jit

CELLS = 512
"""Directions of a program of XLA; those of loops are padded to a multiple of it, too."""
LOCK = threading.RLock()
NOTHING = np.zeros(0)


def padded(w: Direction) -> Direction:
    """Directions (n,) with so many more, along the normal, that `CELLS` divides their number."""
    more = -np.size(w.z) % CELLS
    return Direction(*(np.append(np.asarray(c, float), np.full(more, e)) for c, e in zip(w, NORMAL, strict=True)))


def lobe_values(
    frame: Frame, names: tuple[str, ...], shapes: Float[np.ndarray, "u k"], wi: Direction, wo: Direction
) -> Float[np.ndarray, "u n k+1"]:
    """The lobe at strength 1, and its derivative by each shape.

    Args:
        frame: the lobe without its shapes.
        names: of its shapes.
        shapes: U sets of them.
        wi: directions of `padded`, as many as of `wo`.
        wo: as `wi`.

    Returns:
        Of each set, for each pair of directions, the value in front of the derivatives.
    """
    program = loop_of(frame, names) if usable() else None
    if program is not None:
        shapes = np.ascontiguousarray(shapes, float)
        arrays = [np.ascontiguousarray(c, float) for c in (*wi, *wo)]
        values = np.empty((len(shapes), arrays[0].size, 1 + len(names)))
        addresses = np.empty((len(shapes), len(names) + 7), np.uintp)
        addresses[:, : len(names)] = shapes.ctypes.data + 8 * np.arange(shapes.size).reshape(shapes.shape)
        addresses[:, len(names) : -1] = [a.ctypes.data for a in arrays]
        addresses[:, -1] = values.ctypes.data + values[:1].nbytes * np.arange(len(shapes))
        parameters = NOTHING
        if before := program.rows.prepared:
            parameters = np.stack([program.rows.parameters([], numbers) for numbers in shapes])
            addresses = np.ascontiguousarray(addresses[:, before:])
        if program(parameters, addresses, arrays[0].size) is not None:
            return values
    parts = [_by_xla(frame, names, shapes, wi, wo, k) for k in range(0, wi.z.size, CELLS)]
    return np.concatenate(parts, axis=1)


@functools.lru_cache(maxsize=256)
def loop_of(frame: Frame, names: tuple[str, ...]) -> SumsProgram | None:
    """The loop of a kind of lobe, with its shapes' names; None where XLA computes it."""

    def rows(_: Sequence[Any], *elements: Array) -> Array:
        wi, wo = Direction(*elements[-6:-3]), Direction(*elements[-3:])

        def value(shapes: dict[str, Array]) -> Array:
            return assemble(frame, shapes).f(wi, wo)

        point, one = dict(zip(names, elements[:-6], strict=True)), jnp.eye(len(names))
        if not names:
            return value(point)[None]
        along = functools.partial(jax.jvp, value, (point,))
        f, slopes = jax.vmap(lambda t: along((t,)), out_axes=(None, 0))({n: one[k] for k, n in enumerate(names)})
        return jnp.concatenate([f[None], slopes])

    try:
        name = program_name("lobe", frame, names)
        with LOCK:
            loop = Rows(rows, [], len(names), (1,) * 6, name=name, prepared=prepared(frame))
            return SumsProgram(loop, [], range(1 + len(names)))
    except Unsupported:
        return None


def _by_xla(
    frame: Frame, names: tuple[str, ...], shapes: np.ndarray, wi: Direction, wo: Direction, first: int
) -> np.ndarray:
    pair = [Direction(*(jnp.asarray(c[first : first + CELLS]) for c in w)) for w in (wi, wo)]
    each = (_kernel(frame, names, v, *pair) for v in np.asarray(shapes, float))
    return np.stack([np.concatenate([np.asarray(f)[:, None], np.asarray(slopes)], axis=1) for f, slopes in each])


@kept_jit
def _kernel(
    frame: Frame, names: tuple[str, ...], values: np.ndarray, wi: Direction, wo: Direction
) -> tuple[jax.Array, jax.Array]:
    def one(v: jax.Array, a: Direction, b: Direction) -> jax.Array:
        return assemble(frame, dict(zip(names, v, strict=True))).f(a, b)

    over = lambda f: jax.vmap(f, in_axes=(None, 0, 0))(values, wi, wo)  # noqa: E731
    return over(one), over(jax.jacfwd(one))
