"""Symmetric matrices of an arrow's shape: numbers that all channels share, and numbers of one channel each.

No residual sees numbers of two channels, so that JᵀJ is a corner of the shared numbers, a block for each channel, and
a border between both. With the blocks eliminated (Schur complement) a system costs time in proportion to the number of
channels [Golub & Pereyra 1973; Triggs et al. 2000, §6].
"""

import contextlib
import contextvars
import functools
from types import ModuleType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.fitting.problem.readings import AnyArray

WHOLE = 32  # numbers up to which a matrix is cheaper as a whole
UNROLLED = contextvars.ContextVar("unrolled", default=12)
"""Numbers up to which a program has every step of an elimination by itself: XLA takes far longer to compile more."""


class Sizes(NamedTuple):
    """How many numbers are shared, how many channels there are, and how many numbers are each channel's own."""

    shared: int
    channels: int
    per_channel: int

    @property
    def total(self) -> int:
        """Number of all numbers."""
        return self.shared + self.channels * self.per_channel


class Arrow(NamedTuple):
    """Symmetric matrices over s shared numbers and q own numbers of each of C channels; any leading axes.

    Vectors over them are in the order of the arrow: the shared numbers, then channel by channel.
    """

    corner: Float[AnyArray, "*b s s"]
    border: Float[AnyArray, "*b c s q"]
    blocks: Float[AnyArray, "*b c q q"]

    @classmethod
    def dense(cls, matrix: Float[AnyArray, "*b p p"]) -> "Arrow":
        """A matrix of which nothing is known: all numbers are shared."""
        xp, lead, size = module_of(matrix), matrix.shape[:-2], matrix.shape[-1]
        return cls(matrix, xp.zeros((*lead, 0, size, 0)), xp.zeros((*lead, 0, 0, 0)))

    @property
    def sizes(self) -> Sizes:
        """Numbers of each kind."""
        channels, shared, per_channel = self.border.shape[-3:]
        return Sizes(shared, channels, per_channel)

    def parts(self, v: Float[AnyArray, "*b p"]) -> tuple[Float[AnyArray, "*b s"], Float[AnyArray, "*b c q"]]:
        """The shared numbers of a vector, and those of each channel."""
        s, channels, q = self.sizes
        return v[..., :s], v[..., s:].reshape(*v.shape[:-1], channels, q)

    def diagonal(self) -> Float[AnyArray, "*b p"]:
        """The diagonal."""
        if not self.blocks.size:
            return _diagonal_of(self.corner)
        return joined(*(_diagonal_of(a) for a in (self.corner, self.blocks)))

    def mv(self, v: Float[AnyArray, "*b p"]) -> Float[AnyArray, "*b p"]:
        """The matrix times a vector."""
        if not self.blocks.size:
            return (self.corner @ v[..., None])[..., 0]
        shared, each = self.parts(v)
        return joined(
            (self.corner @ shared[..., None])[..., 0] + _sum_over_channels(self.border @ each[..., None])[..., 0],
            (_transposed(self.border) @ shared[..., None, :, None] + self.blocks @ each[..., None])[..., 0],
        )

    def scaled(self, factor: Float[AnyArray, "*b p"]) -> "Arrow":
        """The matrix with rows and columns times these factors."""
        if not self.blocks.size:
            return self._replace(corner=self.corner * factor[..., :, None] * factor[..., None, :])
        shared, each = self.parts(factor)
        return Arrow(
            self.corner * shared[..., :, None] * shared[..., None, :],
            self.border * shared[..., None, :, None] * each[..., None, :],
            self.blocks * each[..., :, None] * each[..., None, :],
        )

    def plus_diagonal(self, added: Float[AnyArray, "*b p"]) -> "Arrow":
        """The matrix with a vector added to its diagonal."""
        if not self.blocks.size:
            return self._replace(corner=self.corner + _diagonal_matrix(added))
        shared, each = map(_diagonal_matrix, self.parts(added))
        return Arrow(self.corner + shared, self.border, self.blocks + each)

    def restricted(self, kept: AnyArray) -> "Arrow":
        """The matrix with a unit row and column for every number that is not kept."""
        if isinstance(kept, np.ndarray) and kept.all():
            return self
        xp = module_of(kept)
        return self.scaled(xp.where(kept, 1.0, 0.0)).plus_diagonal(xp.where(kept, 0.0, 1.0))

    def solved(self, v: Float[AnyArray, "*b p"]) -> Float[AnyArray, "*b p"]:
        """Solution x of the positive definite system `self x = v`; NaN where there is none."""
        xp = module_of(self.corner)
        if not self.blocks.size:
            if xp is jnp:
                return solve_by_elimination(self.corner, v[..., None])[..., 0]
            return _each_solved(np.asarray(self.corner), np.asarray(v))
        shared, each = self.parts(v)
        border = xp.broadcast_to(self.border, (*v.shape[:-1], *self.border.shape[-3:]))
        eliminated = solve_by_elimination(self.blocks, xp.concatenate([_transposed(border), each[..., None]], axis=-1))
        share, blocks = eliminated[..., :-1], eliminated[..., -1:]
        schur = self.corner - _sum_over_channels(self.border @ share)
        right = shared[..., None] - _sum_over_channels(self.border @ blocks)
        x = solve_by_elimination(schur, right)
        return joined(x[..., 0], (blocks - share @ x[..., None, :, :])[..., 0])

    def whole(self) -> Float[np.ndarray, "*b p p"]:
        """The matrix in full."""
        s, channels, q = self.sizes
        total = self.sizes.total
        matrix = np.zeros((*self.corner.shape[:-2], total, total))
        matrix[..., :s, :s] = self.corner
        for c in range(channels):
            these = slice(s + c * q, s + (c + 1) * q)
            matrix[..., :s, these] = self.border[..., c, :, :]
            matrix[..., these, :s] = _transposed(self.border[..., c, :, :])
            matrix[..., these, these] = self.blocks[..., c, :, :]
        return matrix


def module_of(a: AnyArray) -> ModuleType:
    """The module of an array's functions: NumPy's or JAX's."""
    return np if isinstance(a, np.ndarray) else jnp


def joined(shared: Float[AnyArray, "*b s"], each: Float[AnyArray, "*b c q"]) -> Float[AnyArray, "*b p"]:
    """A vector from its shared numbers and those of each channel."""
    flat = each.reshape(*each.shape[:-2], each.shape[-2] * each.shape[-1])
    return module_of(shared).concatenate([shared, flat], axis=-1)


def _each_solved(matrix: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Solutions of systems side by side, by LAPACK; NaN of those that are singular."""
    with contextlib.suppress(np.linalg.LinAlgError):
        return np.linalg.solve(matrix, v[..., None])[..., 0]
    if v.ndim > 1:
        matrices = np.broadcast_to(matrix, (*v.shape, v.shape[-1]))
        return np.stack([_each_solved(m, row) for m, row in zip(matrices, v, strict=True)])
    return np.full_like(v, np.nan)


def _transposed(a: AnyArray) -> AnyArray:
    return a.swapaxes(-1, -2)


def _diagonal_of(a: Float[AnyArray, "*b n n"]) -> Float[AnyArray, "*b n"]:
    if isinstance(a, np.ndarray):
        return a.diagonal(axis1=-2, axis2=-1)
    # JAX's own chooses by the platform when it runs.
    return a.reshape(*a.shape[:-2], -1)[..., :: a.shape[-1] + 1]


def _diagonal_matrix(a: Float[AnyArray, "*b n"]) -> Float[AnyArray, "*b n n"]:
    return a[..., None] * _like(_unit(a.shape[-1]), a.ndim + 1)


@functools.lru_cache(maxsize=64)
def _unit(size: int) -> np.ndarray:
    return np.eye(size)


def _like(a: np.ndarray, rank: int) -> np.ndarray:
    return a.reshape((1,) * (rank - a.ndim) + a.shape)


def _sum_over_channels(a: Float[AnyArray, "*b c m n"]) -> Float[AnyArray, "*b m n"]:
    return a.sum(axis=-3)


def solve_by_elimination(
    matrix: Float[AnyArray, "*b n n"], right: Float[AnyArray, "*b n m"]
) -> Float[AnyArray, "*b n m"]:
    """Solutions of small positive definite systems side by side, without pivoting; NaN where one is not positive.

    Lineax's machinery takes longer to trace than all else, LAPACK's calls take longer than such small systems, and
    JAX imports SciPy for them.
    """
    xp, size = module_of(right), matrix.shape[-1]
    if not size:
        return right

    def eliminate(k: int | Array, rows: AnyArray) -> AnyArray:
        pivot = rows[..., k, k][..., None]
        row = rows[..., k, :] / xp.where(pivot > 0, pivot, xp.nan)
        others = rows - rows[..., :, k][..., None] * row[..., None, :]
        return xp.where(numbers == k, row[..., None, :], others)

    numbers = _like(np.arange(size)[:, None], right.ndim)
    rows = xp.concatenate([xp.broadcast_to(matrix, (*right.shape[:-2], size, size)), right], axis=-1)
    if xp is jnp:
        return _unrolled(rows) if size <= UNROLLED.get() else jax.lax.fori_loop(0, size, eliminate, rows)[..., size:]
    with np.errstate(all="ignore"):
        for k in range(size):
            rows = eliminate(k, rows)
    return rows[..., size:]


def _unrolled(rows: AnyArray) -> AnyArray:
    """The same of a matrix with its right sides beside it, of which the lower half is not looked at."""
    upper, reduced, solved = [rows[..., k, k:] for k in range(rows.shape[-2])], [], []
    while upper:
        (first, *others), pivot = upper, upper[0][..., :1]
        row = first[..., 1:] / jnp.where(pivot > 0, pivot, jnp.nan)
        reduced.append(row)
        upper = [other - first[..., k + 1, None] * row[..., k:] for k, other in enumerate(others)]
    for number, row in enumerate(reversed(reduced)):
        value = row[..., number:]
        for k, x in enumerate(reversed(solved)):
            value = value - row[..., k, None] * x
        solved.append(value)
    return jnp.stack(solved[::-1], axis=-2)
