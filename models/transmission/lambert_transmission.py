"""The perfect diffuser in transmission."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Sample, Scalar, parameter
from gonio.models.geometry.horizon import Hemispheres, same_side
from gonio.models.warps.hemisphere import cosine_sample

TRANSMITTANCE = ParameterInfo(0.0, 1.0, "1", "transmittance", start=0.5, role="albedo", per_channel=True, linear=True)


class LambertTransmission(AbstractBRDF):
    """f_t = τ/π into the hemisphere opposite to the light, from either side: its transmittance is τ at every incidence.

    Nothing is reflected: `lambert(rho=0.3) + lambert_transmission(tau=0.4)` does both, of light in front.
    """

    tau: Channels = parameter(TRANSMITTANCE)

    @property
    def hemispheres(self) -> Hemispheres:
        return Hemispheres.TRANSMISSION

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.tau / jnp.pi

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        x, y, z = cosine_sample(u1, u2)
        return Direction(x, y, jnp.where(wi.z > 0, -z, z)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return jnp.where(same_side(wi, wo), 0.0, jnp.abs(wo.z) / jnp.pi)
