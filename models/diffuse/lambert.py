"""The perfect diffuser."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, parameter

ALBEDO = ParameterInfo(0.0, 1.0, "1", "albedo", start=0.5, role="albedo", per_channel=True, linear=True)


class Lambert(AbstractBRDF):
    """f = ρ/π: the same radiance in all directions [Lambert 1760]; its albedo is ρ at every incidence."""

    rho: Channels = parameter(ALBEDO)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.rho / jnp.pi
