"""Models over pairs of directions, pair by pair, or every one with every other."""

import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from gonio.models.compiled.dispatch import Formula, values
from gonio.models.geometry.directions import Direction

FEW = 1 << 15
"""Pairs whose directions are repeated in memory rather than in the loops, for which another program is made."""
NARROWEST = 16
"""Numbers of the shortest inner loop: those of the widest vector."""


def _value(model: Any, *components: Any) -> Any:
    return model.f(Direction(*components[:3]), Direction(*components[3:]))


PAIRS = Formula(_value, ((0,),) * 6)
WI_OUTSIDE = Formula(_value, ((0,),) * 3 + ((1,),) * 3)
WO_OUTSIDE = Formula(_value, ((1,),) * 3 + ((0,),) * 3)


WI_FIXED = Formula(_value, ((),) * 3 + ((0,),) * 3)
WO_FIXED = Formula(_value, ((0,),) * 3 + ((),) * 3)
LOOPS = ((WI_OUTSIDE, WI_FIXED), (WO_OUTSIDE, WO_FIXED))
"""For the direction that needs the outer axes: programs for many of it, and for one."""


def directed_values(model: Any, arrays: Sequence[np.ndarray], shape: tuple[int, ...]) -> np.ndarray | None:
    """f of a model, 1/sr, shape (*shape, *channels); None where XLA has to compute it.

    Args:
        model: what has an `f` of two scalar directions.
        arrays: the components of wi and wo, which broadcast.
        shape: to this.
    """
    same = True
    for a in arrays:
        same = same and a.shape == shape
        if a.dtype.kind not in "fiub":
            return None
    dtype = jax.dtypes.canonicalize_dtype(float)
    size = math.prod(shape)
    formula, parts, sizes = PAIRS, arrays, (size,)
    if not same:
        grid = _grid(arrays, shape) if size > FEW else None
        formula, parts, sizes = grid or (PAIRS, [np.broadcast_to(a, shape) for a in arrays], (size,))
    if same and len(shape) == 1:
        return values(PAIRS, model, parts, sizes, dtype)
    # Of one pair, whose time is spent here, the shape does not matter.
    f = values(formula, model, parts if same and size == 1 else [a.reshape(-1) for a in parts], sizes, dtype)
    return None if f is None else f.reshape(shape + f.shape[len(sizes) :])


def _grid(
    arrays: Sequence[np.ndarray], shape: tuple[int, ...]
) -> tuple[Formula, list[np.ndarray], tuple[int, ...]] | None:
    """The formula, the arrays and the sizes of the loops, where one direction needs the outer axes of a shape alone,
    and the other the inner ones."""
    ways = [_axes(arrays[:3], len(shape)), _axes(arrays[3:], len(shape))]
    for (many, one), (outer, inner) in zip(LOOPS, (ways, ways[::-1]), strict=True):
        cut = max(outer, default=-1) + 1
        before, after = shape[:cut], shape[cut:]
        if min(inner, default=cut) < cut or math.prod(after) < NARROWEST:
            continue
        single = math.prod(before) == 1
        parts = [
            _last_axes(np.broadcast_to(a, (*before, *(1,) * len(after))), 0 if single else len(shape))
            if axes == (0,)
            else np.broadcast_to(_last_axes(a, len(after)), after)
            for a, axes in zip(arrays, many.axes, strict=True)
        ]
        return (one, parts, (math.prod(after),)) if single else (many, parts, (math.prod(before), math.prod(after)))
    return None


def _last_axes(array: np.ndarray, count: int) -> np.ndarray:
    """An array less its first axes, which have one number each."""
    return array.reshape(array.shape[max(array.ndim - count, 0) :])


def _axes(arrays: Sequence[np.ndarray], dimensions: int) -> set[int]:
    """The axes of the broadcast shape along which an array has more than one number."""
    return {k + dimensions - a.ndim for a in arrays for k, n in enumerate(a.shape) if n > 1}
