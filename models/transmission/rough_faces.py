"""The light in a sheet between two rough faces, all its bounces: what it reflects and transmits by the incidence.

What a face makes of light is tabulated by its width and index; the script that makes the table is
tests/benchmarks/models/sheet_tables.py. Azimuths do not matter to a total, so that light inside goes by its cosine
alone: by values at nodes, on either side of the critical angle.
"""

import functools
import math
import pathlib
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Scalar
from gonio.models.microfacet.chebyshev import chebyshev_basis

TABLE = pathlib.Path(__file__).with_name("rough_faces.npz")
QUANTUM = 1e-7  # the file holds multiples of it
NARROW = 0.005  # the table is in ln(1 + α/NARROW)
WIDTHS = 4e-3, 0.5  # narrower faces share light as the first does, but beyond 86°
LOG_WIDTHS = tuple(math.log1p(alpha / NARROW) for alpha in WIDTHS)
LOG_INDICES = tuple(0.5 * math.log((eta - 1.0) * (eta + 1.0)) for eta in (1.01, 4.0))  # of √(η² − 1)
SLACK = 1e-4  # a hair beyond the domain: at the bound itself a clip would halve the slope
BEYOND, BEFORE = 6, 12
"""Nodes beyond the critical angle, and before it, where `cosines_outside` are those outside."""
DOUBLINGS = 6
"""Of the passages through the sheet and back: 64."""


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


@functools.lru_cache
def _nodes() -> tuple[np.ndarray, np.ndarray]:
    """(the variable of cosines outside at the nodes, the matrix from values there to a series)."""
    x = -np.cos(np.pi * np.arange(BEFORE) / (BEFORE - 1))
    return (x + 1.0) / 2.0, np.linalg.inv(np.polynomial.chebyshev.chebvander(x, BEFORE - 1)).T


def _fine(alpha: Scalar) -> Scalar:
    """Cosines below which the nodes are close to each other: where a face hides itself, of widths in the table."""
    return 2.0 * jnp.clip(alpha, *WIDTHS) + 0.04


def cosines_outside(alpha: Scalar) -> Scalar:
    """Of the nodes: close to each other where a face of this width hides itself."""
    c, t = _fine(alpha), jnp.asarray(_nodes()[0], alpha.dtype)
    return c * t / (c + 1.0 - t)


def between_cosines(values: Scalar, cosine: Scalar, alpha: Scalar) -> Scalar:
    """From values at `cosines_outside`, on the last axis, those at other cosines (n,)."""
    c = _fine(alpha)
    basis = chebyshev_basis(2.0 * cosine * (1.0 + c) / (cosine + c) - 1.0, BEFORE)
    return (values @ jnp.asarray(_nodes()[1], values.dtype)) @ basis


def _within(x: Scalar, ends: tuple[float, ...]) -> Scalar:
    low, high = ends
    return jnp.clip((2.0 * x - low - high) / (high - low), -1.0 - SLACK, 1.0 + SLACK)


def _met(alpha: Scalar, eta: Scalar) -> Scalar:
    """What faces of these widths (2,) make of light, shape (rows, columns, 2).

    Rows are light from inside at the nodes, then from outside at `cosines_outside`; columns the weights of the nodes
    in what is inside next, and last what leaves, or is reflected at once.
    """
    of_width, of_index = _orders()
    widths = chebyshev_basis(_within(jnp.log1p(alpha / NARROW), LOG_WIDTHS), of_width)
    indices = chebyshev_basis(_within(0.5 * jnp.log((eta - 1.0) * (eta + 1.0)), LOG_INDICES), of_index)
    weights = (widths[:, None, :] * indices[None, :, None]).reshape(of_width * of_index, 2)
    table = jnp.asarray(_table(), eta.dtype)
    met = (table @ weights).reshape(BEYOND + BEFORE + BEFORE, BEYOND + BEFORE + 1, 2)
    # The table errs; light does not grow.
    return met / jnp.maximum(jnp.sum(met, 1, keepdims=True), 1.0)


def _kept(alpha: Scalar, faces: Faces) -> Scalar:
    """What the inside keeps of one passage, at the nodes; the cosine 0, of the first, is as good as 1e-3."""
    excess = (faces.eta - 1.0) * (faces.eta + 1.0)
    angle = 0.25 * np.pi * (1.0 - np.cos(np.pi * np.arange(BEYOND, 0, -1) / BEYOND))
    beyond = jnp.asarray(np.maximum(np.cos(angle), 1e-3), excess.dtype) * jnp.sqrt(excess)
    before = jnp.sqrt(excess + cosines_outside(alpha) ** 2)
    return faces.clear ** (faces.eta / jnp.concatenate([beyond, before]))


def light_through(faces: Faces) -> tuple[Scalar, Scalar]:
    """Shares of light from outside, from the front and from behind, by each side's `cosines_outside`.

    Returns:
        What is reflected, after it was inside, and transmitted (2, sides, cosines); what is not reflected at once
        (sides, cosines).
    """
    n, alphas = BEYOND + BEFORE, jnp.stack([faces.alpha, faces.behind])
    met = jnp.moveaxis(_met(alphas, faces.eta), -1, 0)
    kept = jax.vmap(lambda alpha: _kept(alpha, faces))(alphas)
    # Values at the other face's nodes, made those at a face's own: as they are beyond the critical angle.
    each = jnp.eye(BEFORE, dtype=met.dtype)
    before = jnp.stack([between_cosines(each, cosines_outside(a), b).T for a, b in (alphas, alphas[::-1])])
    other = (
        jnp.zeros((2, n, n), met.dtype)
        .at[:, BEYOND:, BEYOND:]
        .set(before)
        .at[:, :BEYOND, :BEYOND]
        .set(jnp.eye(BEYOND, dtype=met.dtype))
    )
    inside, leaves = (met[:, :, :n] * kept[:, None]) @ other, met[:, :n, n]
    mirrored, enters = inside[:, :n], inside[:, n:]
    # Both passages of light on its way to the back, and to the front: mirrored by the faces, one after the other.
    power = jnp.stack([mirrored[1] @ mirrored[0], mirrored[0] @ mirrored[1]])
    ends = jnp.stack(
        [
            jnp.stack([mirrored[1] @ leaves[0], leaves[1]], 1),
            jnp.stack([leaves[0], mirrored[0] @ leaves[1]], 1),
        ]
    )
    ends, _ = jax.lax.fori_loop(0, DOUBLINGS, lambda _, a: (a[0] + a[1] @ a[0], a[1] @ a[1]), (ends, power))
    light = enters @ ends
    light = jnp.stack([light[0, :, 0], light[1, :, 1], light[0, :, 1], light[1, :, 0]])
    return light.reshape(2, 2, BEFORE), 1.0 - met[:, n:, n]
