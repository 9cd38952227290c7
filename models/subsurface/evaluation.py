"""Models of light below the surface over arrays of distances."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from gonio.models.arrays import Channels, Scalar
from gonio.models.subsurface.base import AbstractBSSRDF

BLOCK = 4096
"""Distances of one pass: one compiled program serves any number of them."""
Integral = Literal["profile", "cumulative", "hankel"]


@eqx.filter_jit
def _values(bssrdf: AbstractBSSRDF, integral: Integral, x: Scalar) -> Channels:
    return jax.vmap(getattr(bssrdf, integral))(x)


def evaluated(bssrdf: AbstractBSSRDF, integral: Integral, x: ArrayLike) -> np.ndarray:
    """R, its cumulative integral, or its Hankel transform at x (mm; 1/mm for "hankel") of any shape S.

    Shape S + (channels,), one channel where the model has none.
    """
    x = np.asarray(x, float)
    flat = x.ravel()
    blocks = [np.resize(flat[k : k + BLOCK], BLOCK) for k in range(0, flat.size, BLOCK)]
    values = [np.asarray(_values(bssrdf, integral, jnp.asarray(b)), float).reshape(BLOCK, -1) for b in blocks]
    return np.concatenate(values)[: flat.size].reshape(*x.shape, -1)


def totals(bssrdf: AbstractBSSRDF) -> np.ndarray:
    """∫ R dA (channels,), one channel where the model has none."""
    return evaluated(bssrdf, "hankel", np.zeros(1))[0]
