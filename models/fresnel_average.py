"""The average of a Fresnel reflectance over diffuse light, 2 ∫ F(μ) μ dμ."""

import functools

import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Channels, Scalar
from gonio.models.fresnel import fresnel_conductor, fresnel_dielectric

NODES = 48


@functools.lru_cache
def _rule() -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(NODES)
    return (x + 1) / 2, w / 2


def _nodes(like: Scalar) -> tuple[Scalar, ...]:
    return tuple(jnp.asarray(a, like.dtype).reshape((-1,) + (1,) * like.ndim) for a in _rule())


def _outside(eta: Scalar) -> Scalar:
    # μ = g sinh y with g = √(η² − 1), where r_s = exp(−2y): smooth for η → 1 too. y as v², as r_p of a large index
    # has its pole beside y = 0.
    v, w = _nodes(eta)
    eta = eta[None]
    g = jnp.sqrt(jnp.maximum((eta - 1.0) * (eta + 1.0), 1e-6))
    span = jnp.arcsinh(1.0 / g)
    y = span * v * v
    mu = g * jnp.sinh(y)
    return jnp.sum(4.0 * w * v * span * g * jnp.cosh(y) * mu * fresnel_dielectric(mu, eta), 0)


def fresnel_average(f0: Channels | None, eta: Channels | None, k: Channels | None) -> Scalar:
    """2 ∫ F μ dμ of what `gonio.models.fresnel.fresnel` means by the same parameters.

    Schlick: f0 + (1 − f0)/21. A dielectric of η < 1 by 1 − F_avg(η) = η² (1 − F_avg(1/η)), as the étendue that
    passes is the same both ways. By a rule of fixed nodes where there is an index: right to 1e-10, but for conductors
    of η < 1 and k < 0.1, whose critical angle is a kink (3e-3 at k = 0).
    """
    if f0 is not None:
        return f0 + (1.0 - f0) / 21.0
    if eta is None:
        return 1.0
    if k is None:
        inside = eta < 1.0
        average = _outside(jnp.where(inside, 1.0 / jnp.where(inside, eta, 1.0), eta))
        return jnp.where(inside, 1.0 - eta * eta * (1.0 - average), average)
    eta, k = jnp.broadcast_arrays(eta, k)
    v, w = _nodes(eta)
    return jnp.sum(4.0 * w * v**3 * fresnel_conductor(v * v, eta[None], k[None]), 0)
