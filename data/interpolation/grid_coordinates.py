"""Where pairs of directions lie in a kind of layout: one compiled program for each kind, whatever their number."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.layouts.angle_layouts import IsotropicGrid
from gonio.data.layouts.base import Layout
from gonio.models.geometry.directions import Direction
from gonio.models.kept_jit import kept_jit

BLOCK = 8192
TINY = 1e-9
"""Radians: azimuths as near below a whole turn are 0."""


class LightForAll(NamedTuple):
    """The only azimuth of the light of a grid, which stands for all: the surface is taken as isotropic.

    Attributes:
        azimuth: of the light, radians.
        delta_phi: the azimuths from it of the nodes of phi_o, (n,), in [0, 2π); mirrored where all lie beyond π.
        side: 1 or −1 where all nodes are on that side of the plane of incidence, and stand for the other; else 0.
    """

    azimuth: float
    delta_phi: np.ndarray
    side: int


def light_for_all(layout: Layout) -> LightForAll | None:
    """That of a grid of azimuths about the surface's x axis; None of any other, and of light of several azimuths."""
    if not layout.one_light_azimuth or set(layout.axes) != {"theta_i", "phi_i", "theta_o", "phi_o"}:
        return None
    light = float(layout.axes["phi_i"][0])
    delta = below_a_turn(layout.axes["phi_o"] - light)
    if (np.sin(delta) <= TINY).all() and (np.sin(delta) < -TINY).any():
        return LightForAll(light, below_a_turn(-delta), -1)
    return LightForAll(light, delta, 1 if delta.max() <= np.pi + TINY else 0)


def below_a_turn(azimuth: np.ndarray) -> np.ndarray:
    """Azimuths in [0, 2π), radians."""
    return np.maximum(np.mod(azimuth + TINY, 2 * np.pi) - TINY, 0.0)


def layout_coordinates(layout: Layout, wi: Direction, wo: Direction) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """`grid_coordinates` of a layout; where one azimuth of the light stands for all, of pairs turned to that one."""
    light = light_for_all(layout)
    if light is None:
        return grid_coordinates(type(layout), wi, wo)
    turned, covered = grid_coordinates(IsotropicGrid, wi, wo)
    theta_i, theta_o, delta_phi = (np.asarray(turned[k], float) for k in ("theta_i", "theta_o", "delta_phi"))
    if light.side:
        delta_phi = light.side * np.minimum(delta_phi, 2 * np.pi - delta_phi)
    phi_i, phi_o = np.full(theta_i.shape, light.azimuth), below_a_turn(light.azimuth + delta_phi)
    return {"theta_i": theta_i, "phi_i": phi_i, "theta_o": theta_o, "phi_o": phi_o}, covered


def grid_coordinates(kind: type[Layout], wi: Direction, wo: Direction) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """(angle on each axis, whether the layout can hold it), (n,) each, of pairs of directions (n,), radians.

    In blocks of one size, so that one program serves any number of pairs.
    """
    parts = [np.asarray(c, float) for c in (*wi, *wo)]
    n, made = parts[0].size, []
    for start in range(0, max(n, 1), BLOCK):
        block = [np.resize(c[start : start + BLOCK], BLOCK) if n else np.zeros(BLOCK) for c in parts]
        made.append(_coordinates(kind, Direction(*block[:3]), Direction(*block[3:])))
    angles = {name: np.concatenate([np.asarray(x[name]) for x, _ in made])[:n] for name in made[0][0]}
    return angles, np.concatenate([np.asarray(c) for _, c in made])[:n]


@kept_jit
def _coordinates(kind: type[Layout], wi: Direction, wo: Direction) -> tuple[dict[str, Any], Any]:
    def one(i: Direction, o: Direction) -> tuple[dict[str, Any], Any]:
        return kind.coordinates(i, o), jnp.asarray(kind.covers(i, o))

    return jax.vmap(one)(wi, wo)
