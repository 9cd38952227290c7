"""Sheen of cloth: an inverted Gaussian-like distribution of facets, brightest at grazing."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import half_angles
from gonio.models.warps.hemisphere import beside

ALPHA = ParameterInfo(0.01, 1.0, "1", "width: the inverse of the sine's power", start=0.3, role="width", log=True)

SMOOTH = 4.0
"""Powers of sinθh from which on rules for integrals see no point in it where h is the normal."""

# Estevez & Kulla 2017, table 1: the fit of the masking at widths 0 and 1.
AT_0 = (25.3245, 3.32435, 0.16801, -1.27393, -4.85967)
AT_1 = (21.5473, 3.82987, 0.19823, -1.97760, -4.32054)


class Charlie(AbstractBRDF):
    """f = D G/(4 cosθi cosθo), D = (2 + 1/α)/(2π) sin^(1/α)θh: sheen [Estevez & Kulla 2017].

    `visibility`: "fitted", the paper's G = 1/(1 + Λi + Λo) (eq. 3, without the terminator's softening of eq. 4, which
    breaks reciprocity), or "ashikhmin", G/(4 cosθi cosθo) = 1/(4(cosθi + cosθo − cosθi cosθo)) [Ashikhmin & Premoze
    2007]. F = 1.
    """

    lobe = True
    violates: ClassVar = {
        "energy": "Narrow ones gain at grazing: 1.07 at cosθi = 0.01 for α = 0.05, 2.1 at 0.001 for α = 0.01;"
        ' "ashikhmin" from α = 0.2 down, 1.24 at 0.01 for α = 0.1.'
    }

    alpha: Channels = parameter(ALPHA)
    visibility: str = eqx.field(static=True, default="fitted", metadata={"choices": ("fitted", "ashikhmin")})

    @property
    def kinked(self) -> bool:
        """Wide ones: sinθh to a small power has a point like a cone's where h is the normal."""
        return isinstance(self.alpha, Tracer) or bool(np.any(np.asarray(self.alpha) > 1 / SMOOTH))

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h, _, across2 = half_angles(wi, wo)
        # ln sin²θh: narrow ones ask it near 1, and at the normal it has no end.
        up2 = h.z * h.z
        low, slanted = up2 < 0.25, across2 > 1e-30
        log_low = jnp.log1p(-jnp.where(low, up2, 0.0))
        log_sin2 = jnp.where(low, log_low, jnp.log(jnp.where(slanted, across2, 1.0)))
        power = 1.0 / self.alpha
        density = (2.0 + power) / (2 * jnp.pi) * jnp.where(slanted, jnp.exp(0.5 * power * log_sin2), 0.0)
        if self.visibility == "ashikhmin":
            return density * 0.25 / (wi.z + wo.z - wi.z * wo.z)
        masked = 1.0 + self._mask(wi.z) + self._mask(wo.z)
        # Divided one by one: the product of three could leave the range of single precision.
        return 0.25 * density / masked / positive(wi.z) / positive(wo.z)

    def _mask(self, cos_t: Scalar) -> Scalar:
        """Λ(θ) of eq. 3, exp(L(cosθ)), mirrored in cosθ = ½ above it; finite at grazing."""
        share = (1.0 - self.alpha) ** 2
        a, b, c, d, e = (at_1 + (at_0 - at_1) * share for at_0, at_1 in zip(AT_0, AT_1, strict=True))

        def fit(x: Scalar) -> Scalar:
            some = x > 0
            power = jnp.where(some, jnp.exp(c * jnp.log(jnp.where(some, x, 1.0))), 0.0)
            return a / (1.0 + b * power) + d * x + e

        low = fit(jnp.minimum(cos_t, 1.0 - cos_t))
        return jnp.exp(jnp.where(cos_t < 0.5, low, 2.0 * fit(jnp.full_like(cos_t, 0.5)) - low))

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """(θo, φ) with φ from the azimuth of wi, the seam of Λ at θo = 60° on u2 = ½, closer towards the horizon."""
        high, rest = u2 < 0.5, 2.0 - 2.0 * u2
        above_horizon = jnp.pi / 6 * rest**4
        theta = jnp.where(high, 2 * jnp.pi / 3 * u2, jnp.pi / 2 - above_horizon)
        rate = jnp.where(high, 2 * jnp.pi / 3, 4 * jnp.pi / 3 * rest**3)
        sin_t, cos_t = jnp.sin(theta), jnp.where(high, jnp.cos(theta), jnp.sin(above_horizon))
        return beside(wi, u1, sin_t, cos_t), 2 * jnp.pi * sin_t * rate
