"""The generalised Trowbridge–Reitz distribution."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from gonio.models.brdf import Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import mirrored_pdf
from gonio.models.microfacet import base as mf
from gonio.models.microfacet.distributions import ggx_cos_1_plus_2_lambda, ggx_cos_over_g1
from gonio.models.special.exprel import exprel
from gonio.models.warps.radial_laws import horizon_law

GAMMA = ParameterInfo(
    0.5, 5.0, "1", "exponent of the tails: 2 is GGX, 1 the tail of Berry's law", start=2.0, role="exponent"
)

EVERY_SLOPE = 1e17  # in units of the width


def log_exprel(x: Scalar) -> Scalar:
    """log((eˣ − 1)/x) for any x, by x/2 + x²/24 − x⁴/2880 near 0."""
    near = jnp.abs(x) < 0.02
    size = jnp.abs(jnp.where(near, 1.0, x))
    far = jnp.maximum(jnp.where(near, 1.0, x), 0.0) + jnp.log(-jnp.expm1(-size) / size)
    x = jnp.where(near, x, 0.0)
    return jnp.where(near, x * (0.5 + x * (1.0 / 24.0 - x * x / 2880.0)), far)


def gtr_d(h: Direction, alpha: Scalar, gamma: Scalar) -> Scalar:
    """Density of normals, 1/sr [Burley 2012, appendix B]; 0 for h.z ≤ 0.

    (γ−1)(α²−1)/(π(1 − α^(2−2γ))) (1 + (α²−1)cos²θ)^(−γ). With L = log α² and φ(x) = (eˣ−1)/x the factor is
    φ(L)/(πφ((1−γ)L)): γ = 1 and α = 1 are no special cases. All in logarithms; sin²θ, not cos²θ, keeps the peak.
    """
    up = h.z > 0
    sin2_h = jnp.where(up, h.x**2 + h.y**2, 0.0)
    size = 2.0 * jnp.log(alpha)
    rise = jnp.log1p(sin2_h * ((1.0 - alpha) * (1.0 + alpha) / alpha**2))
    value = log_exprel(size) - log_exprel((1.0 - gamma) * size) - gamma * (size + rise)
    return jnp.where(up, jnp.exp(value) / jnp.pi, 0.0)


class GTR(mf.AbstractMicrofacet):
    """f = F D G/(4 cosθi cosθo), D ∝ (1 + (α²−1)cos²θ_h)^(−γ): generalised Trowbridge–Reitz [Burley 2012, appendix B].

    D is normalised, ∫ D cosθ dω = 1. Smith's masking is that of GGX slopes of the same alpha, as Burley's is; `smith`:
    "correlated" (height-correlated, the default) or "separable". gamma = 2 is `ggx`. `f0`, or `eta` (and `k`), or none.
    """

    loses_energy = "For gamma > 2 GGX's masking is too strong near grazing: 0.70 at 85° for gamma = 3, α = 0.1."
    violates: ClassVar = {
        "energy": "For gamma < 2 its masking is too weak near grazing: 1.06 at 70°, 1.30 at 80° for gamma = 1, α = .01."
    }

    alpha: Channels = parameter(mf.ALPHA)
    gamma: Channels = parameter(GAMMA)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)
    smith: str = eqx.field(static=True, default="correlated", metadata={"choices": ("correlated", "separable")})

    def density(self, m: Direction) -> Channels:
        return gtr_d(m, self.alpha, self.gamma)

    def visibility(self, wi: Direction, wo: Direction) -> Channels:
        wi, wo = (Direction(w.x, w.y, positive(w.z)) for w in (wi, wo))
        if self.smith == "separable":
            return 0.25 / (ggx_cos_over_g1(wi, *self.widths) * ggx_cos_over_g1(wo, *self.widths))
        s_i, s_o = ggx_cos_1_plus_2_lambda(wi, *self.widths), ggx_cos_1_plus_2_lambda(wo, *self.widths)
        # Both parts of the quotient in units of the larger cosine: its square, in the gradient, does not underflow.
        unit = jax.lax.stop_gradient(jnp.maximum(wi.z, wo.z))
        return (0.5 / unit) / ((wo.z * s_i + wi.z * s_o) / unit)

    def slope_radius(self, u2: Scalar, horizon: Scalar) -> tuple[Scalar, Scalar]:
        # A share of 4e-18 of the facets is steeper, where that slope is below 1; beyond it tails fall as those of GGX.
        last = jnp.exp(20.0 / jnp.maximum(jnp.min(self.gamma) - 1.0, 0.5))
        last = jnp.where(last * jnp.max(self.alpha) < 1.0, last, EVERY_SLOPE)
        return horizon_law(u2, last, horizon, self.mean_widths[0])

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """wi mirrored in a facet drawn from D cosθ [Burley 2012, appendix B], without a seam at γ = 1 or α = 1."""
        size, x = 2.0 * jnp.log(self.mean_widths[0]), (1.0 - jnp.mean(self.gamma)) * 2.0 * jnp.log(self.mean_widths[0])
        flat = jnp.abs(x) < 1e-9
        safe = jnp.where(flat, 1.0, x)
        fall = jnp.where(flat, u2, -jnp.log1p(u2 * jnp.expm1(-safe)) / safe)
        sin2 = jnp.exp(size) * fall * exprel(-size * fall) / exprel(size)
        cos2 = (1.0 - fall) * exprel(size * (1.0 - fall)) / exprel(size)
        s = jnp.sqrt(sin2)
        return reflect(wi, Direction(s * jnp.cos(2 * jnp.pi * u1), s * jnp.sin(2 * jnp.pi * u1), jnp.sqrt(cos2))), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        alpha, gamma = self.mean_widths[0], jnp.mean(self.gamma)
        return mirrored_pdf(lambda m: gtr_d(m, alpha, gamma) * m.z, wi, wo)
