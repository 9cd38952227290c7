"""Sheets by the lobes that reflecting models have: turned over where light comes from behind, or sent through."""

import abc

import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, Sample, Scalar
from gonio.models.geometry.horizon import TWO_SIDED, Hemispheres, turned_over


class AbstractEitherSide(AbstractBRDF):
    """f(i, o) of a model that reflects, with both directions turned to the front; `through`: o mirrored at the sheet.

    What the model sends about the mirror direction then goes straight through.
    """

    @property
    @abc.abstractmethod
    def through(self) -> bool:
        """Whether the light goes through, or back."""

    @abc.abstractmethod
    def facing(self, wi: Direction) -> AbstractBRDF:
        """The model that reflects, as it stands for light from wi."""

    @property
    def hemispheres(self) -> Hemispheres:
        return Hemispheres.TRANSMISSION if self.through else TWO_SIDED

    def _sides(self, wi: Direction) -> tuple[Scalar, Scalar]:
        side = jnp.where(wi.z > 0, 1.0, -1.0)
        return side, -side if self.through else side

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        side, beyond = self._sides(wi)
        return self.facing(wi).formula(turned_over(wi, side), turned_over(wo, beyond))

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        side, beyond = self._sides(wi)
        wo, leaves = self.facing(wi).sample(turned_over(wi, side), u1, u2)
        return turned_over(wo, beyond), leaves

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        side, beyond = self._sides(wi)
        return self.facing(wi).pdf(turned_over(wi, side), turned_over(wo, beyond))

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        side, beyond = self._sides(wi)
        wo, jacobian = self.facing(wi).lobe_map(turned_over(wi, side), u1, u2)
        return turned_over(wo, beyond), jacobian

    def mirror_reflectance(self, wi: Direction) -> Channels:
        """What the model mirrors beside its f: an image too where it goes straight through."""
        return self.facing(wi).mirror_reflectance(turned_over(wi, self._sides(wi)[0]))
