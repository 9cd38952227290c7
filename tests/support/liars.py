"""Models from outside: what no shipped model expresses. None has an importance map of its own."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF


class Foreign(AbstractBRDF):
    """A model of ours without the importance map that would help to integrate it."""

    base: AbstractBRDF

    def formula(self, wi, wo):
        return self.base.formula(wi, wo)


class Lopsided(AbstractBRDF):
    """Reciprocal, but not mirror symmetric; below 0 somewhere where the level is less than 0.3."""

    level: float

    def formula(self, wi, wo):
        return (self.level + 0.3 * (wi.x * wo.y + wo.x * wi.y)) / jnp.pi


class Slightly(AbstractBRDF):
    """Not reciprocal by so much of itself in one corner of the hemisphere: 0.2 rad about one direction of light."""

    share: float

    def formula(self, wi, wo):
        d2 = (wi.x - 0.6) ** 2 + wi.y**2
        return 0.1 * (1 + self.share * jnp.exp(-d2 / 0.01))
