"""Distances between a model and readings in the measures of the literature."""

import functools
import math
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from gonio.fitting.problem.median import sorted_median
from gonio.fitting.problem.readings import Readings, inverse_cube_root
from gonio.models.compiled.dispatch import usable
from gonio.models.compiled.graph import Unsupported
from gonio.models.compiled.sums import Rows, SumsProgram

SMALLEST = 1e-100
"""Values below it have the cube root 0 in loops: their squares are no normal numbers."""
BRACKETED, MANY = 1 << 18, 1 << 22
"""Readings, channels counted apart, from which on only the middle ones are kept for the median, and in single
precision."""
SAMPLED, BRACKET = 1 << 14, (0.45, 0.55)
"""Cells from which a bracket is taken, and its quantiles: 25 standard deviations of a quantile apart."""
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
    bracket = _bracket(model_f, readings) if readings.f.size > BRACKETED else None
    sums, median = np.zeros(7), _Median(bracket, np.float32 if readings.f.size > MANY else np.float64)
    complete, buffer = readings.complete, np.zeros(0)
    for chunk in readings.chunks(readings.f.shape[1]):
        rows = readings.f[chunk].shape
        count = -(-rows[0] * rows[1] // PADDED) * PADDED
        if buffer.shape != (5, count):
            buffer = np.zeros((5, count))
        y, m, cos_i, cosines = (a[: rows[0] * rows[1]].reshape(rows[::-1]) for a in buffer[:4])
        y[:], m[:] = readings.f[chunk].T, model_f[chunk].T
        if not complete:
            for a in (y, m):
                a[~readings.valid[chunk].T] = 0.0
        cos_i[:] = readings.cos_i[chunk]
        np.multiply(cos_i, np.abs(np.asarray(readings.wo.z[chunk])), out=cosines)
        added, share = _sums(buffer, y.size)
        share = share if complete and y.all() else share[y.ravel() != 0]
        sums += added
        median.add(share)
    count = max(1, readings.count)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.sqrt(sums[[0, 2]] / np.where(sums[[1, 3]] > 0, sums[[1, 3]], np.nan))
    return {
        "relative_rms": float(ratios[0]),
        "relative_rms_cosine": float(ratios[1]),
        "median_relative": _median_of_all(model_f, readings, median.kind) if median.missed else median.value(),
        "log_rms": float(np.sqrt(sums[4] / count)),
        "cbrt_rms": float(np.sqrt(sums[5] / count)),
        "bias": float(sums[6] / count),
    }


class _Median:
    """The median of numbers that come in parts; with a bracket, only those in it are kept."""

    def __init__(self, bracket: tuple[float, float] | None, kind: type[np.floating] = np.float64) -> None:
        self.kept: list[np.ndarray] = []
        self.kind = kind
        self.bracket, self.below, self.count = bracket, 0, 0

    def add(self, some: np.ndarray) -> None:
        """Take in some of the numbers."""
        self.count += some.size
        if self.bracket is not None:
            some, (low, high) = some.astype(self.kind, copy=False), self.bracket
            self.below += int(np.count_nonzero(some < low))
            some = some[(some >= low) & (some <= high)]
        self.kept.append(np.array(some))

    def value(self) -> float:
        """The median, unless it is missed; NaN of nothing."""
        if not self.count:
            return float("nan")
        kept = np.concatenate(self.kept)
        if self.bracket is None:
            return sorted_median(kept)
        return float(np.mean(np.partition(kept, self.ranks)[self.ranks]))

    @property
    def ranks(self) -> np.ndarray:
        """Of the two middle numbers, among those that are kept."""
        return np.array([(self.count - 1) // 2, self.count // 2]) - self.below

    @property
    def missed(self) -> bool:
        """Whether the bracket does not hold the median."""
        number = sum(some.size for some in self.kept)
        return self.count > 0 and bool(self.ranks[0] < 0 or self.ranks[1] >= number)


def _bracket(model_f: np.ndarray, readings: Readings) -> tuple[float, float]:
    """Between which numbers the median of |m−y|/|y| lies, from readings at random."""
    n = readings.f.shape[0]
    rows = np.sort(np.random.default_rng(0).choice(n, min(n, SAMPLED), replace=False))
    y, m = readings.f[rows], model_f[rows]
    used = readings.valid[rows] & (y != 0)
    if not used.any():
        return 0.0, math.inf
    low, high = np.quantile(np.abs((m[used] - y[used]) / y[used]), BRACKET)
    return float(low), float(high)


def _median_of_all(model_f: np.ndarray, readings: Readings, kind: type[np.floating]) -> float:
    every = _Median(None, kind)
    for chunk in readings.chunks(readings.f.shape[1]):
        y, m = readings.f[chunk], model_f[chunk]
        used = readings.valid[chunk] & (y != 0)
        every.add((np.abs(m[used] - y[used]) / np.abs(y[used])).astype(every.kind))
    return every.value()


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
