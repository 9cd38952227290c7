"""Microfacets whose slopes have Student's t-distribution: between GGX (γ = 2) and Beckmann (γ → ∞), and beyond GGX."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from gonio.models.brdf import Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import log_cosine, mirrored_pdf
from gonio.models.microfacet import base as mf
from gonio.models.warps.radial_laws import horizon_law, power_rate

GAMMA = ParameterInfo(
    1.6, 40.0, "1", "exponent of the tails: 2 is GGX, many is Beckmann", start=3.0, role="exponent", log=True
)
NODES = 32  # 1 + Λ is then right to 2e-13 for every γ of the domain, at every angle
FARTHEST = 8.0  # exp(−FARTHEST² (1 − 1/(2γ − 1))) < 1e-15 for every γ of the domain


@functools.lru_cache
def _rule() -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    return (x + 1.0) / 2.0, w / 2.0


def _slope_integral(end: Scalar, gamma: Scalar) -> Scalar:
    """∫₀ᵃ (1 + x²/c)^(½−γ) dx, c = γ − 1, with (1 + x²/c)^(½−γ) = exp(−s²), at s = end: a Gaussian for every γ."""
    end, gamma = jnp.broadcast_arrays(end, gamma)
    x, w = (jnp.asarray(a, end.dtype).reshape((1,) * end.ndim + (-1,)) for a in _rule())
    g = (gamma - 0.5)[..., None]
    y = (end[..., None] * x) ** 2
    rates = jnp.exp(y / g - y) / power_rate(y / g)  # √(g/c) exp(−s²) dx/ds
    return jnp.sqrt((gamma - 1.0) / (gamma - 0.5)) * end * jnp.sum(w * rates, axis=-1)


def student_shadowing(w: Direction, alpha_x: Scalar, alpha_y: Scalar, gamma: Scalar) -> tuple[Scalar, Scalar]:
    """(w.z Λ(w), w.z (1 + Λ(w))) of Smith's masking over Student's slopes, w.z > 0 [Ribardière et al. 2017, eq. 13].

    With a = cotθ/α and P the density of one slope, wΛ = α sinθ ∫ₐ (x − a) P dx is closed but for P's distribution
    function, which Ribardière fits by a rational; here it is a quadrature, normalised by the same quadrature.
    """
    b = jnp.sqrt(jnp.maximum((alpha_x * w.x) ** 2 + (alpha_y * w.y) ** 2, 1e-30))
    c = gamma - 1.0
    a = w.z / b
    log_tail = jnp.log1p(a * a / c)
    whole = _slope_integral(jnp.full_like(gamma, FARTHEST), gamma)
    below = 0.5 * _slope_integral(jnp.minimum(jnp.sqrt((gamma - 0.5) * log_tail), FARTHEST), gamma) / whole
    beyond = b * c / (2.0 * gamma - 3.0) * jnp.exp((1.5 - gamma) * log_tail) / (2.0 * whole)
    return jnp.maximum(beyond - w.z * (0.5 - below), 0.0), beyond + w.z * (0.5 + below)


def student_d(h: Direction, alpha_x: Scalar, alpha_y: Scalar, gamma: Scalar) -> Scalar:
    """Density of normals, 1/sr [Ribardière et al. 2017]; 0 for h.z ≤ 0.

    1/(πα_xα_y h.z⁴ (1 + t/c)^γ), t = tan² in units of the widths: h.z² (1 + t/c) is 1 + h.x²(1/(cα_x²) − 1) + ...,
    whose logarithm keeps its digits at the peak and at the horizon.
    """
    up = h.z > 0
    c = gamma - 1.0
    excess = h.x**2 * (1.0 / (c * alpha_x**2) - 1.0) + h.y**2 * (1.0 / (c * alpha_y**2) - 1.0)
    h = Direction(h.x, h.y, jnp.where(up, positive(h.z), 1.0))
    power = (2.0 * gamma - 4.0) * log_cosine(h, jnp.where(up, h.x**2 + h.y**2, 0.0))
    falls = jnp.log1p(jnp.where(up, excess, 0.0))
    half = jnp.exp(0.5 * (power - gamma * falls))  # its square may be too small a number before it is divided
    return jnp.where(up, half / (jnp.pi * alpha_x * alpha_y) * half, 0.0)


class STD(mf.AbstractMicrofacet):
    """f = F D G/(4 cosθi cosθo), D ∝ cos⁻⁴θ_h (1 + tan²θ_h/((γ−1)α²))^(−γ): Student's slopes [Ribardière et al. 2017].

    D is normalised, ∫ D cosθ dω = 1, and G is Smith's masking of these slopes, by quadrature where the paper fits it.
    `smith`: "correlated" (height-correlated, the default) or "separable". `alpha`, or `alpha_x` with `alpha_y`; `f0`,
    or `eta` (and `k`), or none (F = 1). gamma = 2 is `ggx`; the larger gamma, the nearer to `beckmann`.
    """

    gamma: Channels = parameter(GAMMA)
    alpha: Channels | None = parameter(mf.ALPHA, default=None)
    alpha_x: Channels | None = parameter(mf.ALPHA_X, default=None)
    alpha_y: Channels | None = parameter(mf.ALPHA_Y, default=None)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)
    smith: str = eqx.field(static=True, default="correlated", metadata={"choices": ("correlated", "separable")})

    @property
    def accuracy(self) -> float:
        return 2e-13  # of the masking, by quadrature

    def density(self, m: Direction) -> Channels:
        return student_d(m, *self.widths, self.gamma)

    def visibility(self, wi: Direction, wo: Direction) -> Channels:
        wi, wo = (Direction(w.x, w.y, positive(w.z)) for w in (wi, wo))
        (m_i, l_i), (m_o, l_o) = (student_shadowing(w, *self.widths, self.gamma) for w in (wi, wo))
        if self.smith == "separable":
            return 0.25 / (l_i * l_o)
        # Both parts of the quotient in units of the larger cosine: its square, in the gradient, does not underflow.
        unit = jax.lax.stop_gradient(jnp.maximum(wi.z, wo.z))
        return (0.25 / unit) / ((wi.z * wo.z + wo.z * m_i + wi.z * m_o) / unit)

    def slope_radius(self, u2: Scalar, horizon: Scalar) -> tuple[Scalar, Scalar]:
        c = jnp.min(self.gamma) - 1.0
        last = jnp.sqrt(c) * jnp.exp(20.0 / c)  # a share of 4e-18 of the facets is steeper
        return horizon_law(u2, last, horizon, jnp.minimum(*self.mean_widths))

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """wi mirrored in a facet drawn from D cosθ: tan² = c((1 − u2)^(−1/c) − 1) in units of the widths."""
        alpha_x, alpha_y = self.mean_widths
        c = jnp.mean(self.gamma) - 1.0
        r = jnp.sqrt(c * jnp.expm1(-jnp.log1p(-u2) / c))
        p, q = alpha_x * r * jnp.cos(2 * jnp.pi * u1), alpha_y * r * jnp.sin(2 * jnp.pi * u1)
        z = 1.0 / jnp.sqrt(1.0 + p * p + q * q)
        return reflect(wi, Direction(p * z, q * z, z)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        gamma = jnp.mean(self.gamma)
        return mirrored_pdf(lambda m: student_d(m, *self.mean_widths, gamma) * m.z, wi, wo)
