"""The perfect diffuser."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels
from gonio.models.geometry.horizon import is_above
from gonio.models.parameters import ParameterInfo, parameter

ALBEDO = ParameterInfo(0.0, 1.0, "1", "albedo", start=0.5, per_channel=True, linear=True)


class Lambert(AbstractBRDF):
    """f = ρ/π: the same radiance in all directions [Lambert 1760]; its albedo is ρ at every incidence."""

    rho: Channels = parameter(ALBEDO)

    def f(self, wi, wo):
        return self.rho / jnp.pi * jnp.where(is_above(wi, wo), 1.0, jnp.zeros_like(wi.z))
