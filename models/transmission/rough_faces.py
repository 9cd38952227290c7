"""The light in a sheet between two rough faces, all its bounces: what it reflects and transmits by the incidence.

What a face makes of light is tabulated by its width and index; the script that makes the table is
tests/benchmarks/models/sheet_tables.py. Azimuths do not matter to a total, so that light inside goes by its cosine
alone: by values at nodes, on either side of the critical angle.
"""

import functools
import math
import pathlib
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Scalar
from gonio.models.microfacet.chebyshev import chebyshev_basis

TABLE = pathlib.Path(__file__).with_name("rough_faces.npz")
QUANTUM = 1e-7  # the file holds multiples of it
NARROW = 0.005  # the table is in ln(1 + α/NARROW)
LOG_WIDTHS = tuple(
    math.log1p(alpha / NARROW) for alpha in (4e-3, 0.5)
)  # narrower faces share light as these do, but beyond 86°
LOG_INDICES = tuple(0.5 * math.log((eta - 1.0) * (eta + 1.0)) for eta in (1.01, 4.0))  # of √(η² − 1)
SLACK = 1e-4  # a hair beyond the domain: at the bound itself a clip would halve the slope
BEYOND, BEFORE = 6, 9
"""Nodes beyond the critical angle, and before it: their cosines outside are `cosines_outside()`."""
DOUBLINGS = 7
"""Of the passages through the sheet: 128."""


class Faces(NamedTuple):
    """A sheet: the slope widths of its front and back, its index and the transmittance along the normal."""

    alpha: Scalar
    behind: Scalar
    eta: Scalar
    clear: Scalar


@functools.lru_cache
def _table() -> np.ndarray:
    """Coefficients, shape (rows · columns, widths · indices), rows as `_met` returns them."""
    with np.load(TABLE) as file:
        table = QUANTUM * file["faces"]
    return table.reshape(table.shape[0] * table.shape[1], -1)


@functools.lru_cache
def _orders() -> tuple[int, int]:
    with np.load(TABLE) as file:
        return file["faces"].shape[2:]


def cosines_outside() -> np.ndarray:
    return (1.0 - np.cos(np.pi * np.arange(BEFORE) / (BEFORE - 1))) / 2.0


def interpolation(cosine: np.ndarray) -> np.ndarray:
    """The matrix from values at `cosines_outside()` to values at these cosines: polynomials."""
    x, y = 2.0 * cosines_outside() - 1.0, 2.0 * cosine - 1.0
    basis, values = (np.polynomial.chebyshev.chebvander(v, BEFORE - 1) for v in (x, y))
    return values @ np.linalg.inv(basis)


def _within(x: Scalar, ends: tuple[float, ...]) -> Scalar:
    low, high = ends
    return jnp.clip((2.0 * x - low - high) / (high - low), -1.0 - SLACK, 1.0 + SLACK)


def _met(alpha: Scalar, eta: Scalar) -> Scalar:
    """What faces of these widths (2,) make of light, shape (rows, columns, 2).

    Rows are light from inside at the nodes, then from outside at `cosines_outside()`; columns the weights of the nodes
    in what is inside next, and last what leaves.
    """
    of_width, of_index = _orders()
    widths = chebyshev_basis(_within(jnp.log1p(alpha / NARROW), LOG_WIDTHS), of_width)
    indices = chebyshev_basis(_within(0.5 * jnp.log((eta - 1.0) * (eta + 1.0)), LOG_INDICES), of_index)
    weights = (widths[:, None, :] * indices[None, :, None]).reshape(of_width * of_index, 2)
    table = jnp.asarray(_table(), eta.dtype)
    met = (table @ weights).reshape(BEYOND + 2 * BEFORE, BEYOND + BEFORE + 1, 2)
    # The table errs; light does not grow.
    return met / jnp.maximum(jnp.sum(met, 1, keepdims=True), 1.0)


def _cosines_inside(eta: Scalar) -> Scalar:
    """Of the nodes; 0, of the first, is as good as 1e-3."""
    excess = (eta - 1.0) * (eta + 1.0)
    angle = 0.25 * np.pi * (1.0 - np.cos(np.pi * np.arange(BEYOND, 0, -1) / BEYOND))
    beyond = jnp.asarray(np.maximum(np.cos(angle), 1e-3), eta.dtype) * jnp.sqrt(excess)
    before = jnp.sqrt(excess + jnp.asarray(cosines_outside() ** 2, eta.dtype))
    return jnp.concatenate([beyond, before]) / eta


def light_through(faces: Faces) -> Scalar:
    """Shares of light from outside by `cosines_outside()`, less what the face reflects at once, shape (4, cosines).

    Reflected by the front, by the back, transmitted from the front, from behind.
    """
    nodes = BEYOND + BEFORE
    met = _met(jnp.stack([faces.alpha, faces.behind]), faces.eta)
    kept = faces.clear ** (1.0 / _cosines_inside(faces.eta))
    inside, leaves = met[:, :nodes] * kept[None, :, None], met[:nodes, nodes]
    # One passage: light on its way to the back is on its way to the front next, or behind; and the other way round.
    none = jnp.zeros_like(inside[:nodes, :, 0])
    power = jnp.block([[none, inside[:nodes, :, 1]], [inside[:nodes, :, 0], none]])
    ends = jnp.block([[none[:, :1], leaves[:, 1:]], [leaves[:, :1], none[:, :1]]])
    for _ in range(DOUBLINGS):
        ends, power = ends + power @ ends, power @ power
    from_front, from_behind = inside[nodes:, :, 0] @ ends[:nodes], inside[nodes:, :, 1] @ ends[nodes:]
    return jnp.stack([from_front[:, 0], from_behind[:, 1], from_front[:, 1], from_behind[:, 0]])
