"""Samples that transmit, with everything about them in closed form."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import dot
from gonio.models.geometry.sides import EVERYWHERE


class Sheet(AbstractBRDF):
    """A sheet that reflects ρ evenly and transmits τ: a cosine power about straight through, even at power 0.

    f_t = τ (n + 2)/2π cosⁿ(angle from straight through): at normal incidence T = τ. The same from both sides.
    """

    rho: float
    tau: float
    power: float = 0.0

    @property
    def hemispheres(self):
        return EVERYWHERE

    @property
    def isotropic(self):
        return True

    def formula(self, wi, wo):
        through = jnp.maximum(-dot(wi, wo), 1e-12)
        lobe = self.tau * (self.power + 2) / (2 * jnp.pi) * through**self.power
        return jnp.where(wi.z * wo.z > 0, self.rho / jnp.pi, lobe)
