"""Chandrasekhar's H function of isotropic scattering, from its integral in closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.arrays import Channels, Scalar

SQRT3 = 3**0.5


class _Rule:
    """Nodes t of the integral over ln t, 1 − arctan(t)/t there, and the weights over π."""

    def __init__(self, count: int, low: float, high: float, centre: float, scale: float) -> None:
        # Equal steps of x, ln t = centre + scale · sinh x: the integrand falls on both sides, so its poles, all at
        # Im ln t = ±π/2, matter less there and the steps may grow.
        x = np.linspace(np.arcsinh((low - centre) / scale), np.arcsinh((high - centre) / scale), count)
        self.t = np.exp(centre + scale * np.sinh(x))
        self.weight = scale * np.cosh(x) * (x[1] - x[0]) / np.pi
        t2 = np.minimum(self.t, 0.1) ** 2
        series = t2 * (1 / 3 - t2 * (1 / 5 - t2 * (1 / 7 - t2 * (1 / 9 - t2 * (1 / 11 - t2 * (1 / 13 - t2 / 15))))))
        self.bend = np.where(self.t < 0.1, series, 1.0 - np.arctan(self.t) / self.t)


@functools.lru_cache
def _rule(double: bool) -> _Rule:
    # Found by trial against 30 digits, over w from 1e-3 to 1 and μ from 1e-12 to 1: 2e-15 with 96 nodes, 2e-9 with 32.
    return _Rule(96, -10.0, 32.0, 2.0, 8.0) if double else _Rule(32, -5.0, 20.0, 1.0, 4.0)


def absorption_root(w: Channels) -> Channels:
    """γ = √(1 − w); its infinite slope at w = 1 is cut where w ends to differ from 1 in the caller's precision."""
    tiny = float(jnp.finfo(jnp.asarray(w).dtype).eps) ** 2 / 4
    return jnp.sqrt(jnp.maximum(1.0 - w, 0.0) + tiny)


def h_isotropic(mu: Scalar, w: Channels) -> Channels:
    """H(μ) for single-scattering albedo w in [0, 1] and μ in [0, 1] [Chandrasekhar 1960, ch. V].

    ln H = −(μ/π) ∫₀^∞ ln(1 − w arctan(t)/t)/(1 + μ²t²) dt. Near t = 0 the logarithm's argument is
    (3γ² + t²)/(3 + t²) to the order of t² for every w, and that part integrates to ln((1 + √3 μ)/(1 + √3 γ μ)); what
    is left is smooth in ln t.
    """
    return (1.0 + SQRT3 * mu) / (1.0 + SQRT3 * absorption_root(w) * mu) * jnp.exp(-_correction(mu, w))


def half_space_albedo(mu: Scalar, w: Channels) -> Channels:
    """1 − √(1 − w) H(μ), what a half space of isotropic scatterers reflects, with all digits as w goes to 0."""
    root = absorption_root(w)
    level = 1.0 / (1.0 + SQRT3 * root * mu)
    return level * (w / (1.0 + root) - root * (1.0 + SQRT3 * mu) * jnp.expm1(-_correction(mu, w)))


def _correction(mu: Scalar, w: Channels) -> Channels:
    """The smooth rest of −ln H(μ), in proportion to w where that is small.

    The logarithms depend on w alone: the loop over nodes keeps them out of the directions'.
    """
    rule = _rule(jnp.result_type(mu, w) == jnp.float64)
    dtype = jnp.result_type(mu, w)
    t, bend, weight = (jnp.asarray(a, dtype) for a in (rule.t, rule.bend, rule.weight))
    w = jnp.asarray(w, dtype)
    white = 1.0 - w

    def log_rest(t_j: Scalar, bend_j: Scalar, weight_j: Scalar) -> Scalar:
        t2 = t_j * t_j
        return weight_j * jnp.log1p(w * (bend_j * (3.0 + t2) - t2) / (3.0 * white + t2))

    logs = jax.vmap(log_rest)(t, bend, weight)

    def node(total: Channels, tabulated: tuple[Scalar, Channels]) -> tuple[Channels, None]:
        t_j, log_j = tabulated
        far = mu * t_j
        return total + log_j * (far / (1.0 + far * far)), None

    return jax.lax.scan(node, jnp.zeros(jnp.shape(w), dtype), (t, logs), unroll=8)[0]
