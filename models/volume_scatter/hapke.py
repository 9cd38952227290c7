"""Hapke's regolith."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.geometry.phase_angle import henyey_greenstein, phase_chords
from gonio.models.volume_scatter.chandrasekhar_h import absorption_root, h_isotropic
from gonio.models.volume_scatter.half_space import MULTIPLE
from gonio.models.volume_scatter.hot_spot import AbstractHotSpot

LOBE = ParameterInfo(0.0, 0.99, "1", "asymmetry of both lobes of the phase function", start=0.3, role="phase")
BACKWARD = ParameterInfo(-1.0, 1.0, "1", "backward less forward share of the phase function", start=0.3, role="phase")
SURGE = ParameterInfo(0.0, 1.0, "1", "height of the opposition surge", start=0.5, role="weight")
SURGE_WIDTH = ParameterInfo(
    1e-4, 10.0, "1", "width of the opposition surge, in tan(g/2)", start=0.1, role="hot_spot", log=True
)


class Hapke(AbstractHotSpot):
    """f = w/(4π (μi + μo)) ((1 + B(g)) P(g) + H(μi) H(μo) − 1): a regolith [Hapke 1981; 1986 for B].

    g is the phase angle, B = b0/(1 + tan(g/2)/h), and P the two-term Henyey-Greenstein function (1+c)/2 · (1−b²)/(1 −
    2b cos g + b²)^1.5 + (1−c)/2 · (1−b²)/(1 + 2b cos g + b²)^1.5: c > 0 scatters backwards. `h_function`: "1981"
    (the default) H = (1 + 2μ)/(1 + 2γμ), γ = √(1−w); "2002" 1/(1 − wμ(r0 + ½(1 − 2r0μ) ln(1 + 1/μ))), r0 = (1−γ)/(1+γ)
    [Hapke 2002, eq. 13]; "exact" Chandrasekhar's. Without macroscopic roughness.
    """

    violates: ClassVar = {
        "energy": "w = 1 gains where the scattering is not isotropic or surges: 1.17 at normal incidence for b = 0.5 "
        "and c = 1, 1.06 at grazing for b0 = 1 and h = 0.1; the H of 1981 adds 0.04 at normal incidence"
    }
    loses_energy = "multiple scattering takes no notice of P: with w = 1, b = 0.5, c = −1 it reflects 0.89 at μ = 0.5"

    w: Channels = parameter(MULTIPLE)
    b: Channels = parameter(LOBE)
    c: Channels = parameter(BACKWARD)
    b0: Channels = parameter(SURGE)
    h: Channels = parameter(SURGE_WIDTH)
    h_function: str = eqx.field(static=True, default="1981", metadata={"choices": ("1981", "2002", "exact")})

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        apart, together = phase_chords(wi, wo)
        back, forward = henyey_greenstein(apart, self.b), henyey_greenstein(together, self.b)
        phase = 0.5 * ((1.0 + self.c) * back + (1.0 - self.c) * forward)
        surge = self.b0 * self.h * together / (self.h * together + apart)
        twice = self._h(wi.z) * self._h(wo.z) - 1.0
        return self.w * ((1.0 + surge) * phase + twice) / (4 * jnp.pi * (wi.z + wo.z))

    def _h(self, mu: Scalar) -> Channels:
        if self.h_function == "exact":
            return h_isotropic(mu, self.w)
        gamma = absorption_root(self.w)
        if self.h_function == "1981":
            return (1.0 + 2.0 * mu) / (1.0 + 2.0 * gamma * mu)
        r0 = (1.0 - gamma) / (1.0 + gamma)
        grazing = jnp.log1p(mu) - jnp.log(mu)
        return 1.0 / (1.0 - self.w * mu * (r0 + (0.5 - r0 * mu) * grazing))

    def hot_spot(self, wi: Direction) -> tuple[Scalar, Scalar]:
        peak = 1.0 - jnp.max(self.b)
        near = jnp.minimum(jnp.min(self.h), jnp.minimum(peak, wi.z))
        return jnp.maximum(near, 1e-8), jnp.clip(wi.z, 1e-8, peak)
