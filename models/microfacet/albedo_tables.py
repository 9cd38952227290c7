"""Directional albedos that have no closed form, from Chebyshev series of our own integrals.

The script that makes them is tests/benchmarks/albedo_tables.py.

A series is first contracted to the one width at hand (`*_series`, which costs nothing per direction), then summed for
each cosine. What is tabulated is what is missing of 1, over a bound of it: 1 − E keeps its digits where it is 1e-8.
"""

import functools
import math
import pathlib
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.models.arrays import Scalar
from gonio.models.microfacet.chebyshev import chebyshev_basis, clenshaw

Series = Float[Array, "..."]  # the coefficients on the first axis, channels on the second where there are some

TABLES = pathlib.Path(__file__).with_name("albedos.npz")
ALPHA_LEAST = 1e-4
ALPHA_BELOW = 6e-5  # a series has its worst slopes at its ends: of what is known by little of 1, α = 1e-4 lies inside
LOG_G = tuple(0.5 * math.log((eta - 1.0) * (eta + 1.0)) for eta in (1.01, 4.0))  # of √(η² − 1), the coat's indices
QUANTUM = 1e-11  # the file holds multiples of it
SLACK = 1e-6
NODES = 64  # of the average over the cosines: the integrand is a polynomial of degree 55 times a smooth function


@functools.lru_cache
def _table(name: str) -> np.ndarray:
    with np.load(TABLES) as tables:
        return QUANTUM * tables[name]


class Cosines(NamedTuple):
    """A variable s in [0, 1] for μ, fine where μ is below the width: ln(1 + μ/(cα)) ∝ s^power, or a ratio ∝ s^power."""

    logarithmic: bool
    c: float
    power: int

    def inverse(self, mu: Scalar, alpha: Scalar) -> Scalar:
        """s of μ > 0."""
        c = self.c * alpha
        ratio = jnp.log1p(mu / c) / jnp.log1p(1.0 / c) if self.logarithmic else mu * (1.0 + c) / (mu + c)
        return jnp.cbrt(ratio) if self.power == 3 else jnp.sqrt(ratio)

    def forward(self, s: Scalar, alpha: Scalar) -> tuple[Scalar, Scalar]:
        """(μ, dμ/ds) of s in [0, 1]."""
        c, t = self.c * alpha, s**self.power
        rate = self.power * s ** (self.power - 1)
        if self.logarithmic:
            span = jnp.log1p(1.0 / c)
            return c * jnp.expm1(span * t), (c * jnp.exp(span * t)) * span * rate
        denominator = c + (1.0 - t)
        return c * t / denominator, c * (1.0 + c) / denominator**2 * rate


class Kind(NamedTuple):
    """Layout of a table: cosines, whether by ln α or α, from `least` on, and the bound (1 + μ/(reach α))^−fall."""

    cosines: Cosines
    log_alpha: bool
    reach: float
    fall: int
    least: float = ALPHA_LEAST


_GGX = Kind(Cosines(True, 3.0, 3), True, 1.0, 2)
_BECKMANN = Kind(Cosines(False, 6.0, 2), False, 4.0, 2)
KINDS = {
    "ggx_correlated": _GGX,
    "ggx_separable": _GGX,
    "beckmann_correlated": _BECKMANN,
    "beckmann_separable": _BECKMANN,
    "kelemen_white": Kind(Cosines(True, 3.0, 2), True, 1.0, 2, ALPHA_BELOW),
    "kelemen_grazing": Kind(Cosines(True, 3.0, 2), True, 1.0, 0, ALPHA_BELOW),
    "coat": Kind(Cosines(True, 3.0, 2), True, 1.0, 0),
}


def _within(x: Scalar) -> Scalar:
    # A hair beyond the domain: at the bound itself a clip would halve the slope.
    return jnp.clip(x, -1.0 - SLACK, 1.0 + SLACK)


def _width_coordinate(kind: Kind, alpha: Scalar) -> Scalar:
    share = jnp.log(alpha) / math.log(kind.least) if kind.log_alpha else (1.0 - alpha) / (1.0 - kind.least)
    return _within(1.0 - 2.0 * share)


def width_series(name: str, alpha: Scalar) -> Series:
    """The series in s of one table at one width (or one a channel), α in [1e-4, 1]."""
    table = jnp.asarray(_table(name), alpha.dtype)
    return jnp.tensordot(table, chebyshev_basis(_width_coordinate(KINDS[name], alpha), table.shape[1]), 1)


def tabulated(name: str, series: Series, mu: Scalar, alpha: Scalar) -> Scalar:
    """The tabulated quantity, ≥ 0, at a cosine μ in (0, 1]."""
    kind = KINDS[name]
    value = clenshaw(series, 2.0 * kind.cosines.inverse(mu, alpha) - 1.0)
    return jnp.maximum(value, 0.0) / (1.0 + mu / (kind.reach * alpha)) ** kind.fall


@functools.lru_cache
def _average_rule(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(NODES)
    return np.polynomial.chebyshev.chebvander(x, size - 1), (x + 1) / 2, w / 2


def average(name: str, series: Series, alpha: Scalar) -> Scalar:
    """2 ∫ (tabulated) μ dμ of the very series at hand, so that what is given back is what is missing."""
    kind = KINDS[name]
    basis, s, w = (jnp.asarray(a, alpha.dtype) for a in _average_rule(series.shape[0]))
    s, w = (a.reshape(a.shape + (1,) * alpha.ndim) for a in (s, w))
    alpha = alpha[None]
    mu, rate = kind.cosines.forward(s, alpha)
    value = jnp.maximum(jnp.tensordot(basis, series, 1), 0.0) / (1.0 + mu / (kind.reach * alpha)) ** kind.fall
    return jnp.sum(2.0 * w * rate * mu * value, 0)


def coat_series(alpha: Scalar, eta: Scalar) -> Series:
    """The series in s of E(μ) of dielectric GGX facets, α in [1e-4, 1] and η in [1.01, 4]."""
    table = jnp.asarray(_table("coat"), alpha.dtype)
    alpha, eta = jnp.broadcast_arrays(alpha, eta)
    low, high = LOG_G
    log_g = 0.5 * jnp.log(jnp.maximum((eta - 1.0) * (eta + 1.0), 1e-6))
    coordinate = _within(2.0 * (log_g - low) / (high - low) - 1.0)
    widths = chebyshev_basis(_width_coordinate(KINDS["coat"], alpha), table.shape[1])
    indices = chebyshev_basis(coordinate, table.shape[2])
    return jnp.einsum("mae,a...,e...->m...", table, widths, indices)
