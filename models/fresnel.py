"""Fresnel reflectance of a smooth interface, for unpolarised light: for one direction, and on average."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Channels, Scalar

NODES = 48  # of the average


def fresnel_schlick1994(cos_d: Scalar, f0: Scalar) -> Scalar:
    """Schlick's approximation f0 + (1 − f0)(1 − cos_d)⁵ [Schlick 1994, eq. 15]; cos_d, f0 in [0, 1]."""
    m = 1.0 - cos_d
    m2 = m * m
    return f0 + (1.0 - f0) * (m2 * m2 * m)


def fresnel_dielectric(cos_d: Scalar, eta: Scalar) -> Scalar:
    """Reflectance of a dielectric of relative index `eta` > 0; cos_d in [0, 1]; 1 in total internal reflection.

    r_s = (1 − η²)/(c + g)², r_p = (η² − 1)((η² + 1)c² − 1)/(η²c + g)² with g = √(η² − sin²): the textbook's
    quotients multiplied out, so that η − 1 is carried and no digit is lost as η → 1.
    """
    excess = (eta - 1.0) * (eta + 1.0)
    g2 = excess + cos_d * cos_d
    transmits = g2 > 0
    g = jnp.sqrt(jnp.where(transmits, g2, 1.0))
    eta2 = eta * eta
    ratio_s, ratio_p = 1.0 / (cos_d + g), 1.0 / (eta2 * cos_d + g)
    # Towards grazing the same as 1 less a small number, whose slope by the index is then no difference of equal terms.
    small_s, small_p = 2.0 * cos_d * ratio_s, 2.0 * eta2 * cos_d * ratio_p
    r_s = jnp.where(small_s < 0.5, small_s - 1.0, -excess * ratio_s**2)
    r_p = jnp.where(small_p < 0.5, small_p - 1.0, excess * ((eta2 + 1.0) * cos_d * cos_d - 1.0) * ratio_p**2)
    # At g = 0 the interface reflects all, unless there is none (η = 1 at grazing).
    return jnp.where(transmits, 0.5 * (r_s * r_s + r_p * r_p), jnp.where(excess == 0, 0.0, 1.0))


def fresnel_dielectric_inside(cos_d: Scalar, eta: Scalar) -> Scalar:
    """Reflectance of the same interface for light inside the dielectric; cos_d in [0, 1] is the cosine inside.

    As `fresnel_dielectric` of 1/η, with η − 1 carried: g = √(1 − η² sin²) is the cosine outside.
    """
    excess = (eta - 1.0) * (eta + 1.0)
    eta2 = eta * eta
    g2 = eta2 * cos_d * cos_d - excess
    transmits = g2 > 0
    g = jnp.sqrt(jnp.where(transmits, g2, 1.0))
    ratio_s, ratio_p = 1.0 / (eta * cos_d + g), 1.0 / (cos_d + eta * g)
    small_s, small_p = 2.0 * eta * cos_d * ratio_s, 2.0 * cos_d * ratio_p
    r_s = jnp.where(small_s < 0.5, small_s - 1.0, excess * ratio_s**2)
    r_p = jnp.where(small_p < 0.5, small_p - 1.0, -excess * ((eta2 + 1.0) * cos_d * cos_d - eta2) * ratio_p**2)
    return jnp.where(transmits, 0.5 * (r_s * r_s + r_p * r_p), jnp.where(excess == 0, 0.0, 1.0))


def fresnel_conductor(cos_d: Scalar, eta: Scalar, k: Scalar) -> Scalar:
    """Reflectance of an interface of complex relative index η + ik (η > 0, k ≥ 0); cos_d in [0, 1].

    With a + ib = √((η + ik)² − sin²) [Born & Wolf, §14.4.1]. The smaller of a² and b² comes from the product
    ab = ηk, so neither cancels for good metals or for weak absorbers.
    """
    # What may be 0 and is a divisor has a number added that is below rounding: a selection would cost more
    least = float(jnp.finfo(jnp.result_type(cos_d, eta)).tiny) ** 0.5
    sin2_d = (1.0 - cos_d) * (1.0 + cos_d)
    real = (eta - k) * (eta + k) - sin2_d
    product = eta * k
    modulus2 = jnp.sqrt(real * real + 4.0 * (product * product) + least)
    large = 0.5 * (modulus2 + jnp.abs(real))
    a = jnp.where(real > 0, large, product) * jax.lax.rsqrt(large)
    c2, cross = cos_d * cos_d, 2.0 * a * cos_d
    # r_s (1 + r_p/r_s)/2 over one denominator
    total_s, sum_p = modulus2 + c2, modulus2 * c2 + sin2_d * sin2_d
    return (total_s - cross) * sum_p / ((total_s + cross) * (sum_p + cross * sin2_d) + least)


def fresnel(cos_d: Scalar, f0: Channels | None, eta: Channels | None, k: Channels | None) -> Scalar:
    """The reflectance that the given parameters mean: none, 1; `f0`, Schlick; `eta` (with `k`), exact."""
    if f0 is not None:
        return fresnel_schlick1994(cos_d, f0)
    if eta is None:
        return jnp.ones_like(cos_d)
    return fresnel_dielectric(cos_d, eta) if k is None else fresnel_conductor(cos_d, eta, k)


def fresnel_of(parameters: object, cos_d: Scalar) -> Channels:
    """`fresnel` by the fields f0, eta and k of a model; one that it does not have is None."""
    return fresnel(cos_d, *(getattr(parameters, name, None) for name in ("f0", "eta", "k")))


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
    """2 ∫ F μ dμ of what `fresnel` means by the same parameters.

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
