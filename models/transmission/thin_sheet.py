"""A sheet that diffuses what it reflects and what it transmits, from either side."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from gonio.models.brdf import (
    AbstractBRDF,
    AbstractComposite,
    Channels,
    Direction,
    ParameterInfo,
    Sample,
    Scalar,
    parameter,
)
from gonio.models.diffuse.lambert import ALBEDO
from gonio.models.geometry.horizon import EVERYWHERE, TWO_SIDED, Hemispheres, same_side
from gonio.models.transmission.lambert_transmission import TRANSMITTANCE, LambertTransmission
from gonio.models.warps.hemisphere import cosine_sample

BEHIND = ParameterInfo(
    0.0, 1.0, "1", "albedo of light from behind (rho where it is left out)", start=0.5, role="albedo",
    per_channel=True, linear=True,
)  # fmt: skip


class TwoSidedLambert(AbstractBRDF):
    """f = ρ/π on the front, ρ_behind/π on the back, each back to its own side."""

    rho: Channels
    rho_behind: Channels

    @property
    def hemispheres(self) -> Hemispheres:
        return TWO_SIDED

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return jnp.where(wi.z > 0, self.rho, self.rho_behind) / jnp.pi

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        x, y, z = cosine_sample(u1, u2)
        return Direction(x, y, jnp.where(wi.z > 0, z, -z)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return jnp.where(same_side(wi, wo), jnp.abs(wo.z) / jnp.pi, 0.0)


class ThinSheet(AbstractComposite):
    """f_r = ρ/π on either side, f_t = τ/π through it: paper, cloth, a leaf [Ross 1981].

    `rho_behind` is the albedo of light from behind, where the sides differ; τ is the same both ways, by reciprocity.
    What is absorbed, 1 − ρ − τ, must not be negative.
    """

    rho: Channels = parameter(ALBEDO)
    tau: Channels = parameter(TRANSMITTANCE)
    rho_behind: Channels | None = parameter(BEHIND, default=None)

    @property
    def hemispheres(self) -> Hemispheres:
        return EVERYWHERE

    @property
    def violates(self) -> Mapping[str, str]:
        albedos = [v for v in (self.rho, self.rho_behind) if v is not None]
        if any(isinstance(v, Tracer) for v in (*albedos, self.tau)):
            return {}
        most = max(float(np.max(np.asarray(r) + np.asarray(self.tau))) for r in albedos)
        return {"energy": f"ρ + τ = {most:.3g}: more leaves the sheet than arrives"} if most > 1 + 1e-12 else {}

    def terms(self) -> tuple[AbstractBRDF, ...]:
        behind = self.rho if self.rho_behind is None else self.rho_behind
        return TwoSidedLambert(self.rho, behind), LambertTransmission(tau=self.tau)
