"""A lit disc with circular grooves or brush marks, in colour: what a compact disc shows under a lamp."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.channels import Channels
from gonio.data.material import Material
from gonio.figures.spectral_colour import channel_colour
from gonio.figures.spheres import encoded
from gonio.models.brdf import AbstractBRDF
from gonio.models.deferred import deferred
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction

if TYPE_CHECKING:
    from matplotlib import patches
    from matplotlib.axes import Axes
else:
    patches = deferred("matplotlib.patches")

SIDE = 320
INNER = 0.3
"""Radius of the hole over that of the disc."""
EYE, LAMP = (0.0, -1.3, 2.6), (0.0, 2.6, 2.2)
"""Where the eye and the lamp are, in radii of the disc, whose middle is the origin and whose normal is z."""
FINEST = np.arange(390.0, 731.0, 10.0)
"""nm: a rainbow of a few wavelengths would be a row of spots."""
SIZE = (4.0, 4.0)
"""Inches."""
GROUND = "#111111"
WHITE = 0.99
"""Quantile of the brightness that is shown as white."""


def at_wavelengths(material: Material, wavelengths_nm: np.ndarray) -> AbstractBRDF:
    """The model with its parameters between their wavelengths, linearly, and beyond them as at the outermost."""
    known = material.channels.wavelengths_nm
    if known is None:
        raise GonioError(f"{material.name} has no wavelengths; a disc is lit by a spectrum")
    order = np.argsort(known)
    nodes = np.asarray(known)[order]

    def between(leaf: jax.Array) -> jax.Array:
        if jnp.shape(leaf) != (nodes.size,):
            return leaf
        values = np.asarray(leaf)[order]
        if np.allclose(1000 * values, nodes):  # a wavelength itself, µm, has no outermost
            return jnp.asarray(wavelengths_nm / 1000)
        return jnp.asarray(np.interp(wavelengths_nm, nodes, values))

    return jax.tree.map(between, material.brdf)


@dataclasses.dataclass(frozen=True)
class LitDisc:
    """The picture of a disc: RGBA bytes (side, side, 4), and what was taken for granted."""

    rgba: np.ndarray
    words: str


def lit_disc(material: Material, lamp: tuple[float, float, float] = LAMP, side: int = SIDE) -> LitDisc:
    """The picture of a disc of a spectral material, whose local x axis points outwards everywhere.

    Args:
        material: with wavelengths; its parameters are interpolated between them.
        lamp: place of the lamp, a point, in radii of the disc.
        side: pixels.

    Raises:
        GonioError: for a material without wavelengths, and a lamp below the disc.
    """
    if lamp[2] <= 0:
        raise GonioError(f"the lamp is at the height {lamp[2]:g}, below the disc; give one above 0")
    step = (np.arange(side) + 0.5) * 2 / side - 1
    x, y = np.meshgrid(step, -step)
    r = np.hypot(x, y)
    inside = (r < 1) & (r > INNER)
    x, y, r = x[inside], y[inside], r[inside]
    wi, distance2 = _local(lamp, x, y, r)
    wo, _ = _local(EYE, x, y, r)
    brdf = at_wavelengths(material, FINEST)
    radiance = evaluate_in_blocks(brdf, wi, wo) * (wi.z / distance2)[:, None]
    colour = channel_colour(Channels.of_wavelengths(FINEST.tolist()))
    assert colour.matrix is not None
    linear = np.maximum(radiance @ colour.matrix.T, 0.0)
    linear /= max(float(np.quantile(linear.max(axis=1), WHITE)), 1e-300)
    rgba = np.zeros((side, side, 4), np.uint8)
    rgba[inside] = np.concatenate([encoded(linear), np.full((len(linear), 1), 255, np.uint8)], axis=1)
    return LitDisc(rgba, colour.words)


def draw_disc(ax: Axes, rgba: np.ndarray) -> None:
    """The picture on a dark ground."""
    ax.axis("off")
    ax.set_aspect("equal")
    ax.add_patch(patches.Rectangle((-1.05, -1.05), 2.1, 2.1, facecolor=GROUND))
    ax.imshow(rgba, extent=(-1, 1, -1, 1), interpolation="none", zorder=2)
    ax.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05))


def _local(place: tuple[float, float, float], x: np.ndarray, y: np.ndarray, r: np.ndarray) -> tuple[Direction, ...]:
    # The direction to a place, in the frame whose x axis points outwards, and the squared distance.
    to = np.array(place)[:, None] - np.stack([x, y, np.zeros_like(x)])
    distance2 = np.sum(to**2, axis=0)
    to = to / np.sqrt(distance2)
    outwards, around = (to[0] * x + to[1] * y) / r, (to[1] * x - to[0] * y) / r
    return Direction(outwards, around, to[2]), distance2
