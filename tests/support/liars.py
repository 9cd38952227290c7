"""Models from outside: what no shipped model expresses. None has an importance map of its own."""

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.sides import EVERYWHERE


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


MISTAKES = ("", "η² lost", "sign of wi·h", "cosine doubled", "sides differ")


class Transmitting(AbstractBRDF):
    """A surface of ours that transmits, with one of the `MISTAKES` that programs make, by its number."""

    base: AbstractBRDF
    mistake: jnp.ndarray

    @property
    def hemispheres(self):
        return EVERYWHERE

    @property
    def index_behind(self):
        return self.base.index_behind

    def formula(self, wi, wo):
        through, front = (wi.z > 0) != (wo.z > 0), wi.z > 0
        # Where h points down, from inside, D is 0.
        wrong = [
            jnp.ones_like(wo.z),
            jnp.where(front, self.base.index_behind**-2.0, 1.0),
            jnp.where(front, 1.0, 0.0),
            jnp.abs(wo.z),
            jnp.where(front, 1.0, 0.8),
        ]
        return self.base.f(wi, wo) * jnp.where(through, jnp.stack(wrong)[self.mistake], 1.0)


def transmitting(base, mistake=""):
    """The surface with a mistake by its name: all of them are one program."""
    return Transmitting(base, jnp.asarray(MISTAKES.index(mistake)))
