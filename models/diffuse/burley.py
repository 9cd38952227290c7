"""Disney's diffuse term."""

from typing import ClassVar

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, Scalar, parameter
from gonio.models.diffuse.energy_preserving_oren_nayar import ROUGHNESS
from gonio.models.diffuse.lambert import ALBEDO
from gonio.models.geometry.directions import add, dot
from gonio.models.warps.hemisphere import polar_map


class BurleyDiffuse(AbstractBRDF):
    """f = ρ/π (1 + (F90−1)(1−μi)⁵)(1 + (F90−1)(1−μo)⁵): Disney's diffuse term [Burley 2012, §5.3].

    F90 = ½ + 2 roughness cos²θd, θd half the angle between wi and wo: smooth surfaces darken at grazing, rough ones
    brighten in retroreflection.
    """

    violates: ClassVar = {
        "energy": "rough and white it gains: roughness 1 has the albedo 1.04 at μ = 1, 1.25 at 0.2, 1.54 at 0.01"
    }

    rho: Channels = parameter(ALBEDO)
    roughness: Channels = parameter(ROUGHNESS)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        h = add(wi, wo)
        cos2_d = 0.25 * dot(h, h)
        rise = (0.5 + 2.0 * self.roughness * cos2_d) - 1.0
        value = (1.0 + rise * (1.0 - wi.z) ** 5) * (1.0 + rise * (1.0 - wo.z) ** 5)
        return self.rho / jnp.pi * value

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return polar_map(u1, u2)
