"""Rahman, Pinty and Verstraete's surface for remote sensing."""

from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.geometry.directions import norm
from gonio.models.geometry.guards import positive
from gonio.models.geometry.phase_angle import phase_chords
from gonio.models.volume_scatter.hot_spot import AbstractHotSpot

LEVEL = ParameterInfo(
    0.0, 1.0, "1", "amplitude of the reflectance", start=0.2, role="scale", per_channel=True, linear=True
)
BOWL = ParameterInfo(0.0, 2.0, "1", "shape: below 1 a bowl, above 1 a bell", start=0.8, role="exponent")
ASYMMETRY = ParameterInfo(-0.95, 0.95, "1", "asymmetry: below 0 scatters backwards", start=-0.1, role="phase")
HOT_SPOT = ParameterInfo(
    0.0, 1.0, "1", "hot spot: 1 has none, 0 the highest", start=0.5, role="hot_spot", per_channel=True
)


class RPV(AbstractHotSpot):
    """f = ρ0/π (μi μo (μi + μo))^(k−1) F(g) (1 + (1−ρc)/(1+G)): land surfaces [Rahman, Pinty & Verstraete 1993].

    F = (1−Θ²)/(1 + 2Θ cos g + Θ²)^1.5, g the phase angle; G² = tan²θi + tan²θo − 2 tanθi tanθo cosφ. The bidirectional
    reflectance factor is π f. The authors set ρc = ρ0.
    """

    violates: ClassVar = {
        "energy": "ρ0 is no albedo, and k < 1 gains at grazing without a limit: ρ0 = ρc = 0.2, k = 0.6 and Θ = −0.1 "
        "reflect 1.09 at μ = 0.05 and 5.3 at 0.001"
    }

    rho0: Channels = parameter(LEVEL)
    k: Channels = parameter(BOWL)
    theta: Channels = parameter(ASYMMETRY)
    rho_c: Channels = parameter(HOT_SPOT)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        power = self.k - 1.0
        mu_i, mu_o = positive(wi.z), positive(wo.z)
        bowl = (jnp.power(mu_i, power) * jnp.power(mu_o, power)) * jnp.power(mu_i + mu_o, power)
        spot = 1.0 + (1.0 - self.rho_c) * _closeness(wi, mu_i, wo, mu_o)
        return self.rho0 / jnp.pi * bowl * _asymmetric(wi, wo, self.theta) * spot

    def hot_spot(self, wi: Direction) -> tuple[Scalar, Scalar]:
        """At grazing it is as wide as μ²."""
        peak = 1.0 - jnp.max(jnp.abs(self.theta))
        return jnp.clip(wi.z**2, 1e-8, peak), jnp.clip(wi.z, 1e-8, peak)


def _asymmetric(wi: Direction, wo: Direction, theta: Channels) -> Scalar:
    # 1 + 2Θ cos g + Θ² by the chord that is small where the function peaks.
    apart, together = phase_chords(wi, wo)
    d = jnp.where(theta < 0, (1.0 + theta) ** 2 - theta * apart**2, (1.0 - theta) ** 2 + theta * together**2)
    return (1.0 - theta) * (1.0 + theta) / (d * jnp.sqrt(d))


def _closeness(wi: Direction, mu_i: Scalar, wo: Direction, mu_o: Scalar) -> Scalar:
    # 1/(1 + G), G = |wi/μi − wo/μo| in the plane: by sum and difference, so that it keeps its digits where they agree.
    low, high = jnp.minimum(mu_i, mu_o), jnp.maximum(mu_i, mu_o)
    mean, apart = 0.5 * (mu_i + mu_o) / high, (mu_i - mu_o) / high
    x, y = ((i - o) * mean - 0.5 * (i + o) * apart for i, o in ((wi.x, wo.x), (wi.y, wo.y)))
    return low / (low + norm(Direction(x, y, jnp.zeros_like(x))))
