"""Interpolation of channels whose mirror image at the plane of incidence is their negative, as of Mueller elements."""

import dataclasses
from types import ModuleType
from typing import Any, cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gonio.data.polarisation import change_sign_mirrored
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction

IN_PLANE = 1e-9
"""Sine of the angle to the plane of incidence, times those of both polar angles, that is none."""


class MirrorSigned(AbstractBRDF):
    """A mirror symmetric interpolant of which some channels change their sign from one side to the other."""

    base: AbstractBRDF
    odd: tuple[bool, ...] = eqx.field(static=True)
    side: int = eqx.field(static=True, default=0)
    """Of the plane of incidence, on which alone the base was read, 1 or −1; 0: both."""

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic

    def formula(self, wi: Direction, wo: Direction) -> Float[Array, " channel"]:
        sign = jnp.where(_lateral(wi, wo) < 0, -1.0, 1.0)
        return self.base.formula(wi, self._read(wi, wo, jnp)) * jnp.where(jnp.asarray(self.odd), sign, 1.0)

    def array_values(self, wi: Direction, wo: Direction) -> np.ndarray | None:
        values = self.base.array_values(wi, self._read(wi, wo, np))
        return None if values is None else values * self._signs(wi, wo).astype(values.dtype)

    def ends(self, wi: Direction, wo: Direction) -> tuple[np.ndarray, np.ndarray]:
        """The least and the greatest, (n, C) each, of the readings that are interpolated at directions (n,)."""
        low, high = cast(Any, self.base).ends(wi, self._read(wi, wo, np))
        signs = self._signs(wi, wo)
        return np.where(signs < 0, -high, low), np.where(signs < 0, -low, high)

    def _signs(self, wi: Direction, wo: Direction) -> np.ndarray:
        return np.where(np.array(self.odd), _signs(wi, wo)[:, None], 1.0)

    def _read(self, wi: Direction, wo: Direction, xp: ModuleType) -> Direction:
        """The direction of the detector, or its mirror image, on the side that was read."""
        if not self.side:
            return wo
        lateral = _lateral(wi, wo)
        twice = xp.where(lateral * self.side < 0, 2 * lateral / xp.maximum(wi.x**2 + wi.y**2, 1e-30), 0.0)
        return Direction(wo.x + twice * wi.y, wo.y - twice * wi.x, wo.z)


def _lateral(wi: Direction, wo: Direction) -> Any:
    """Above 0 where the azimuth from light to detector is between 0 and π."""
    return wi.x * wo.y - wi.y * wo.x


def _signs(wi: Direction, wo: Direction) -> np.ndarray:
    return np.where(_lateral(wi, wo) < 0, -1.0, 1.0)


def _side(table: Table) -> int:
    """The side on which all readings of a list are; 0 for both, and for grids, which know it."""
    if table.layout.gridded:
        return 0
    lateral = _lateral(*table.layout.directions(0, table.layout.size))
    return int((lateral > -IN_PLANE).all()) - int((lateral < IN_PLANE).all())


def on_one_side(table: Table) -> Table:
    """The table with the values of such channels as they are on the side of azimuth differences from 0 to π."""
    wi, wo = table.layout.directions(0, table.layout.size)
    odd = np.array(change_sign_mirrored(table.channels.names))
    signs = np.where(odd, _signs(wi, wo).reshape(-1, 1), 1.0).reshape(*table.layout.shape, odd.size)
    return dataclasses.replace(table, f=np.asarray(table.f[...]) * signs)


def with_signs(brdf: AbstractBRDF, table: Table) -> AbstractBRDF:
    """The interpolant of the table that `on_one_side` gives as one of the table itself."""
    return MirrorSigned(brdf, tuple(change_sign_mirrored(table.channels.names)), _side(table))
