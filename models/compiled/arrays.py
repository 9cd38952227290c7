"""JAX's operations that move or choose elements, on arrays of anything: numbers, or the nodes of a graph."""

from collections.abc import Callable
from typing import Any

import numpy as np


def _broadcast(a: np.ndarray, shape: tuple[int, ...], broadcast_dimensions: tuple[int, ...], **_: Any) -> np.ndarray:
    sizes = dict(zip(broadcast_dimensions, a.shape, strict=True))
    return np.broadcast_to(a.reshape([sizes.get(k, 1) for k in range(len(shape))]), shape)


def _slice(
    a: np.ndarray, start_indices: tuple[int, ...], limit_indices: tuple[int, ...], strides: tuple[int, ...] | None
) -> np.ndarray:
    steps = strides or (1,) * a.ndim
    return a[tuple(slice(*s) for s in zip(start_indices, limit_indices, steps, strict=True))]


def _pad(a: np.ndarray, value: np.ndarray, padding_config: tuple[tuple[int, int, int], ...]) -> np.ndarray:
    inner = [n + max(n - 1, 0) * between for n, (_, _, between) in zip(a.shape, padding_config, strict=True)]
    added = [(max(low, 0), max(high, 0)) for low, high, _ in padding_config]
    padded = np.full([n + sum(ends) for n, ends in zip(inner, added, strict=True)], value.item(), a.dtype)
    places = [slice(low, low + n, 1 + c[2]) for n, (low, _), c in zip(inner, added, padding_config, strict=True)]
    padded[tuple(places)] = a
    cut = [
        slice(max(-low, 0), n - max(-high, 0)) for n, (low, high, _) in zip(padded.shape, padding_config, strict=True)
    ]
    return padded[tuple(cut)]


MOVES: dict[str, Callable[..., np.ndarray]] = {
    "broadcast_in_dim": _broadcast,
    "slice": _slice,
    "reshape": lambda a, new_sizes, **_: a.reshape(new_sizes),
    "squeeze": lambda a, dimensions: np.squeeze(a, dimensions),
    "expand_dims": lambda a, dimensions: np.expand_dims(a, dimensions),
    "transpose": lambda a, permutation: np.transpose(a, permutation),
    "rev": lambda a, dimensions: np.flip(a, dimensions),
    "stack": lambda *a, axis=0, **_: np.stack(a, axis),
    "concatenate": lambda *a, dimension: np.concatenate(a, dimension),
    "pad": _pad,
    "stop_gradient": lambda a, **_: a,
    "copy": lambda a, **_: a,
    "copy_p": lambda a, **_: a,
}
"""Each takes the operands, and the operation's parameters by name."""


def contracted(
    first: np.ndarray, second: np.ndarray, dimension_numbers: Any, product: Callable[[Any, Any], Any],
    total: Callable[[list[Any]], Any],
) -> np.ndarray:  # fmt: skip
    """JAX's `dot_general` with any multiplication and summation, shape (batch, free of first, free of second)."""
    (of_first, of_second), (batch_first, batch_second) = dimension_numbers
    a, b = _arranged(first, batch_first, of_first), _arranged(second, batch_second, of_second)
    out = np.empty((a.shape[0], a.shape[1], b.shape[1]), a.dtype)
    for batch, i, j in np.ndindex(out.shape):
        out[batch, i, j] = total([product(x, y) for x, y in zip(a[batch, i], b[batch, j], strict=True)])
    batches = [first.shape[k] for k in batch_first]
    return out.reshape(batches + _free(first, batch_first, of_first) + _free(second, batch_second, of_second))


def _free(a: np.ndarray, batch: Any, summed: Any) -> list[int]:
    return [n for k, n in enumerate(a.shape) if k not in (*batch, *summed)]


def _arranged(a: np.ndarray, batch: Any, summed: Any) -> np.ndarray:
    """The array with the axes (batch, free, summed)."""
    free = [k for k in range(a.ndim) if k not in (*batch, *summed)]
    sizes = [int(np.prod([a.shape[k] for k in axes], dtype=int)) for axes in (batch, free, summed)]
    return a.transpose([*batch, *free, *summed]).reshape(sizes)
