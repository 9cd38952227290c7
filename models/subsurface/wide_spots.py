"""A BSSRDF as an instrument with wide spots sees it: a diffuse BRDF."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, Scalar
from gonio.models.subsurface.base import AbstractBSSRDF


class WideSpots(AbstractBRDF):
    """f = Ft(wi) (∫R dA) Ft(wo)/π: light and detector far wider than the light travels; times the share `kept`.

    `kept` is what spots of finite size leave of it (see `gonio.models.subsurface.spots.kept_share`).
    """

    bssrdf: AbstractBSSRDF
    kept: Channels | float = 1.0

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        b = self.bssrdf
        return self.kept * b.transmittance(wi.z) * b.total() * b.transmittance(wo.z) / jnp.pi

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        # Even in the cosine, by which Ft is smooth down to the horizon
        z, phi = 1.0 - u1, 2.0 * jnp.pi * u2
        sine = jnp.sqrt((1.0 - z) * (1.0 + z))
        return Direction(sine * jnp.cos(phi), sine * jnp.sin(phi), z), jnp.full_like(u1, 2.0 * jnp.pi)
