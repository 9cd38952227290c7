"""Distances between a model and readings in the measures of the literature."""

import functools
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from gonio.fitting.problem.readings import Readings, chunks, inverse_cube_root
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import Rows, SumsProgram

SMALLEST = 1e-100
"""Values below it have the cube root 0 in loops: their squares are no normal numbers."""
MANY = 1 << 22
PADDED = 16
"""A multiple of the numbers of any vector."""


def metrics(model_f: np.ndarray, readings: Readings) -> dict[str, float]:
    """Distances between a model's values and the valid readings.

    Args:
        model_f: values m (n, C), 1/sr, at the directions of the readings.
        readings: values y (n, C), 1/sr, and which of them are valid.

    Returns:
        `relative_rms` = √(Σ(m−y)²/Σy²); `relative_rms_cosine`, the same of f cosθi cosθo; `median_relative`, the
        median of |m−y|/|y|; `log_rms` of log(1+f) [Ngan 2005]; `cbrt_rms` of (f cosθi)^⅓; `bias`, the mean of m−y.
    """
    # Of very many the median is one of numbers in single precision.
    kind = np.float64 if readings.f.size <= MANY else np.float32
    sums, relative, known = np.zeros(7), np.empty(readings.f.size, kind), 0
    complete, buffer = bool(readings.valid.all()), np.zeros(0)
    for chunk in chunks(*readings.f.shape):
        rows = readings.f[chunk].shape
        count = -(-rows[0] * rows[1] // PADDED) * PADDED
        if buffer.shape != (5, count):
            buffer = np.zeros((5, count))
        y, m, cos_i, cosines = (a[: rows[0] * rows[1]].reshape(rows[::-1]) for a in buffer[:4])
        y[:], m[:] = readings.f[chunk].T, model_f[chunk].T
        if not complete:
            for a in (y, m):
                a[~readings.valid[chunk].T] = 0.0
        cos_i[:] = np.abs(np.asarray(readings.wi.z)[chunk])
        np.multiply(cos_i, np.abs(np.asarray(readings.wo.z)[chunk]), out=cosines)
        added, share = _sums(buffer, y.size)
        share = share if complete and y.all() else share[y.ravel() != 0]
        sums += added
        relative[known : known + share.size] = share
        known += share.size
    count, relative = max(1, readings.count), relative[:known]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.sqrt(sums[[0, 2]] / np.where(sums[[1, 3]] > 0, sums[[1, 3]], np.nan))
    return {
        "relative_rms": float(ratios[0]),
        "relative_rms_cosine": float(ratios[1]),
        "median_relative": float(np.median(relative, overwrite_input=True)) if known else float("nan"),
        "log_rms": float(np.sqrt(sums[4] / count)),
        "cbrt_rms": float(np.sqrt(sums[5] / count)),
        "bias": float(sums[6] / count),
    }


def _sums(arrays: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums over so many readings of `arrays` (5, n): y, m, cosθi, cosθi cosθo, and room; and |m−y|/|y| of each.

    The sums are those of squares of m − y, of y, of both times the cosines, of the difference of log(1 + f) and of that
    of the cube roots, and that of m − y. Beyond the readings y and m are 0.
    """
    program = _program() if usable() else None
    if program is None:
        y, m, cos_i, cosines = arrays[:4, :number]
        off = m - y
        logs = np.sign(m) * np.log1p(np.abs(m)) - np.sign(y) * np.log1p(np.abs(y))
        roots = np.cbrt(m * cos_i) - np.cbrt(y * cos_i)
        squares = [np.sum(a * a) for a in (off, y, off * cosines, y * cosines, logs, roots)]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.array([*squares, off.sum()]), np.abs(off / y)
    addresses = np.array([[row.ctypes.data for row in arrays]], np.uintp)
    sums = program(np.zeros(0), addresses, arrays.shape[1])
    assert sums is not None  # nothing in the formula asks for XLA
    return sums[0], arrays[4, :number]


@functools.cache
def _program() -> SumsProgram | None:
    def rows(_: Sequence[Any], y: Array, m: Array, cos_i: Array, cosines: Array) -> Array:
        off = m - y
        logs, roots = (of(m) - of(y) for of in (_log, lambda v: _cube_root(v * cos_i)))
        return jnp.stack([off, y, off * cosines, y * cosines, logs, roots, jnp.ones(()), jnp.abs(off / y)])

    try:
        return SumsProgram(Rows(rows, [], 0, (1,) * 4), [*((k, k) for k in range(6)), (0, 6)], [7])
    except Unsupported:
        return None


def _log(v: Array) -> Array:
    return jnp.sign(v) * jnp.log1p(jnp.abs(v))


def _cube_root(v: Array) -> Array:
    size = jnp.abs(v)
    return jnp.where(size > SMALLEST, v * inverse_cube_root(jnp.maximum(size, SMALLEST) ** 2), 0.0)
