"""A table of both sides of a sample as a material: each of its parts is interpolated by itself, never across."""

from typing import Any, cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.sides import Hemispheres, hemispheres_of


class TwoSided(AbstractBRDF):
    """One BRDF, of mirrored directions, for each pair of sides of light and detector; 0 where there is none."""

    parts: tuple[AbstractBRDF, ...]
    sides: tuple[tuple[int, int], ...] = eqx.field(static=True)
    index: Float[Array, " channel"] | float = 1.0
    """Refractive index behind over that in front."""

    @property
    def hemispheres(self) -> Hemispheres:
        return hemispheres_of(frozenset(self.sides))

    @property
    def index_behind(self) -> Float[Array, " channel"] | float:
        return self.index

    @property
    def isotropic(self) -> bool:
        return all(part.isotropic for part in self.parts)

    def formula(self, wi: Direction, wo: Direction) -> Float[Array, " channel"]:
        mirrored = [w._replace(z=jnp.abs(w.z)) for w in (wi, wo)]
        total = jnp.zeros(())
        for part, (light, detector) in zip(self.parts, self.sides, strict=True):
            here = (light * wi.z > 0) & (detector * wo.z > 0)
            total = total + jnp.where(here, part.formula(mirrored[0], mirrored[1]), 0.0)
        return total

    def ends(self, wi: Direction, wo: Direction) -> tuple[np.ndarray, np.ndarray]:
        """The least and the greatest, (n, C) each, of the readings that are interpolated at directions (n,)."""
        light, detector = (np.where(np.asarray(w.z) > 0, 1, -1) for w in (wi, wo))
        wi, wo = (Direction(*(np.asarray(c) for c in (w.x, w.y, np.abs(w.z)))) for w in (wi, wo))
        made: list[np.ndarray] = []
        for part, sides in zip(self.parts, self.sides, strict=True):
            here = (light == sides[0]) & (detector == sides[1])
            light_here, detector_here = (Direction(*(c[here] for c in w)) for w in (wi, wo))
            of_part = np.stack(cast(Any, part).ends(light_here, detector_here))
            made = made or [np.full((2, light.size, of_part.shape[-1]), np.nan)]
            made[0][:, here] = of_part
        return made[0][0], made[0][1]
