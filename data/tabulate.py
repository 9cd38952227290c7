"""A model on the cells of a layout: a compiled kernel that gets the trigonometry of each axis as an input."""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.layouts.base import Layout, Trig
from gonio.models.brdf import AbstractBRDF
from gonio.models.compiled.directed import NARROWEST
from gonio.models.compiled.dispatch import Formula
from gonio.models.compiled.dispatch import values as program_values
from gonio.models.compiling import wide_jit
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.half_vector import stated_half_angles

BLOCK_CELLS = 1 << 19
"""Cells of one call of the kernel: enough to hide the cost of the call, few enough to need little memory."""


def block_rows(layout: Layout, block_cells: int = BLOCK_CELLS) -> int:
    """Rows of the leading axis in one call of the kernel: ranges of a multiple of it need no padding."""
    calls = -(-layout.size // block_cells)
    return max(1, -(-layout.shape[0] // calls))


def grid_values(
    brdf: AbstractBRDF, layout: Layout, start_row: int = 0, stop_row: int | None = None, block_cells: int = BLOCK_CELLS
) -> np.ndarray:
    """f, 1/sr, of the cells in the rows start..stop of the leading axis: ``(rows, *layout.shape[1:],
    channels)``.

    0 where a direction is at or below the horizon. A grey model has one channel. The last block is padded, so
    that one compilation serves a layout, whatever the range.
    """
    start, stop, _ = slice(start_row, stop_row).indices(layout.shape[0])
    if layout.gridded and (values := _compiled(brdf, layout, start, stop)) is not None:
        return values
    step = block_rows(layout, block_cells)
    block = _grid_block if layout.gridded else _scattered_block
    first = np.asarray(block(brdf, layout, start, step))
    if stop - start <= step:
        return first[: stop - start]
    out = np.empty((stop - start, *first.shape[1:]), first.dtype)
    out[:step] = first
    for row in range(start + step, stop, step):
        out[row - start : row - start + step] = block(brdf, layout, row, step)[: stop - row]
    return out


def _compiled(brdf: AbstractBRDF, layout: Layout, start: int, stop: int) -> np.ndarray | None:
    """The cells of the rows from loops over the axes, or None where XLA has to compute them."""
    dtype = jax.dtypes.canonicalize_dtype(float)
    angles = [a[start:stop] if k == 0 else a for k, a in enumerate(layout.axes.values())]
    sizes = tuple(a.size for a in angles)
    if 0 in sizes:
        return None
    trig = [f(a).astype(dtype) for a in angles for f in (np.cos, np.sin)]
    in_loops = sizes[-1] >= NARROWEST
    if not in_loops:
        trig = [
            c.reshape(-1)
            for pair in zip(np.ix_(*trig[::2]), np.ix_(*trig[1::2]), strict=True)
            for c in _whole(pair, sizes)
        ]
    values = program_values(
        _formula(type(layout), len(sizes), in_loops), brdf, trig, sizes if in_loops else (math.prod(sizes),), dtype
    )
    return None if values is None else values.reshape(*sizes, -1)


def _whole(pair: tuple[np.ndarray, np.ndarray], shape: tuple[int, ...]) -> list[np.ndarray]:
    return [np.broadcast_to(c, shape) for c in pair]


def _cell(brdf: AbstractBRDF, layout: type[Layout], trig: Trig) -> jax.Array:
    """f of the cell whose angles have this trigonometry."""
    dtype = trig[0][0].dtype
    wi, wo = (Direction(*(jnp.asarray(c, dtype) for c in w)) for w in layout.pair(trig))
    half = jax.tree.map(lambda c: jnp.asarray(c, dtype), layout.half_angles(trig))
    with stated_half_angles(wi, wo, half):
        return brdf.f(wi, wo)


@functools.cache
def _formula(layout: type[Layout], axes: int, in_loops: bool) -> Formula:
    """f of a cell from the trigonometry of its angles, in one loop or in one for each axis."""

    def value(model: Any, *trig: Any) -> Any:
        return _cell(model, layout, list(zip(trig[::2], trig[1::2], strict=True)))

    return Formula(value, tuple((k if in_loops else 0,) for k in range(axes) for _ in range(2)))


def _grid_block(brdf: AbstractBRDF, layout: Layout, start: int, rows: int) -> np.ndarray:
    dtype = jnp.result_type(float)
    angles = [_padded(a, start, rows) if k == 0 else a for k, a in enumerate(layout.axes.values())]
    trig = [(np.cos(a).astype(dtype), np.sin(a).astype(dtype)) for a in angles]
    return np.asarray(_kernel(brdf, type(layout), trig)).reshape(rows, *layout.shape[1:], -1)


def _scattered_block(brdf: AbstractBRDF, layout: Layout, start: int, rows: int) -> np.ndarray:
    cells = np.minimum(np.arange(start, start + rows), layout.size - 1)
    wi, wo = layout.directions_at(cells)
    return np.asarray(evaluate(brdf, wi, wo)).reshape(rows, -1)


def _padded(axis: np.ndarray, start: int, rows: int) -> np.ndarray:
    part = axis[start : start + rows]
    return np.pad(part, (0, rows - part.size), mode="edge")


@wide_jit
def _kernel(brdf: AbstractBRDF, layout: type[Layout], trig: Trig) -> jax.Array:
    def cell(*trig: tuple[Any, Any]) -> jax.Array:
        return _cell(brdf, layout, trig)

    for k in reversed(range(len(trig))):
        cell = jax.vmap(cell, in_axes=[0 if j == k else None for j in range(len(trig))])
    return cell(*trig)
