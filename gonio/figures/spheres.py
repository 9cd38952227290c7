"""Lit spheres: what a ball of the material looks like, its light on the left."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from gonio.figures.style import FAINT
from gonio.models.deferred import deferred

if TYPE_CHECKING:
    from matplotlib import patches
    from matplotlib.axes import Axes
else:
    patches = deferred("matplotlib.patches")

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction

SIDE = 144
UNKNOWN = (128, 128, 128, 70)
"""RGBA of a pixel of which nothing is known."""
LIGHTS = ((35.0, 25.0), (100.0, 15.0))
"""Angle between light and eye, and height of the light above the horizontal plane through both, degrees."""


def sphere_pairs(side: int = SIDE) -> "tuple[np.ndarray, Direction, list[Direction]]":
    """(inside, to the eye, to each light): the local directions at the pixels of a sphere seen from afar.

    `inside` is (side, side), rows from top to bottom; directions have components of the shape of its true pixels. The
    local x axis lies along the parallels of latitude, so that brushed metal is brushed about the vertical axis.
    """
    from gonio.models.geometry.directions import Direction  # loads JAX, which no picture needs

    step = (np.arange(side) + 0.5) * 2 / side - 1
    x, y = np.meshgrid(step, -step)
    inside = x**2 + y**2 < 1
    n = np.stack([x[inside], y[inside], np.sqrt(np.maximum(1 - x[inside] ** 2 - y[inside] ** 2, 1e-12))])
    t = np.stack([n[2], np.zeros_like(n[0]), -n[0]])
    t /= np.linalg.norm(t, axis=0)
    b = np.cross(n, t, axis=0)

    def local(w: np.ndarray) -> Direction:
        return Direction(*(np.tensordot(w, axis, axes=1) for axis in (t, b, n)))

    lights = []
    for phase, height in np.radians(LIGHTS):
        rise = math.asin(math.sin(height) * math.sin(phase))
        across = math.sqrt(max(0.0, 1 - math.cos(phase) ** 2 - math.sin(rise) ** 2))
        lights.append(local(np.array([-across, math.sin(rise), math.cos(phase)])))
    return inside, local(np.array([0.0, 0.0, 1.0])), lights


def encoded(linear: np.ndarray) -> np.ndarray:
    """sRGB bytes of linear values, cut off at 0 and 1 [IEC 61966-2-1]."""
    v = np.clip(np.nan_to_num(linear), 0, 1)
    return np.round(255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)).astype(np.uint8)


def sphere_pixels(linear: np.ndarray, side: int = SIDE) -> np.ndarray:
    """RGBA bytes (side, side, 4) of a sphere, pale where nothing is known (NaN).

    `linear`: sRGB before encoding, (pixels inside, 3).
    """
    inside, _, _ = sphere_pairs(side)
    rgba = np.zeros((side, side, 4), np.uint8)
    known = np.isfinite(linear).all(axis=1, keepdims=True)
    opaque = np.concatenate([encoded(linear), np.full((len(linear), 1), 255, np.uint8)], axis=1)
    rgba[inside] = np.where(known, opaque, np.array(UNKNOWN, np.uint8))
    return rgba


def spheres_size(rows: int) -> tuple[float, float]:
    """(width, height), inches, of a panel with so many rows of spheres."""
    return 4.9, 2.5 * rows + 0.25


def draw_spheres(ax: Axes, rows: Sequence[tuple[str, Sequence[np.ndarray]]]) -> None:
    """Rows of spheres (such as readings and model), each with its name; one sphere (RGBA) for each of `LIGHTS`."""
    ax.set_aspect("equal")
    ax.axis("off")
    for j, (phase, _) in enumerate(LIGHTS):
        ax.text(0.5 + 1.08 * j, 0.03, f"light at {phase:g}° from the eye", ha="center", fontsize=9)
    for k, (name, spheres) in enumerate(rows):
        for j, rgba in enumerate(spheres):
            x, y = 1.08 * j, -1.18 * k
            image = ax.imshow(rgba, extent=(x, x + 1, y - 1, y), interpolation="none")
            image.set_clip_path(patches.Circle((x + 0.5, y - 0.5), 0.494, transform=ax.transData))
        if name:
            ax.text(1.04, -1.18 * k - 1.0, name, color=FAINT, fontsize=9, ha="center", va="top")
    ax.set(xlim=(-0.05, 2.15), ylim=(-1.18 * len(rows) + 0.02, 0.14))


def png(rgba: np.ndarray) -> bytes:
    """A PNG of pixels (rows, columns, 4), bytes."""
    data = io.BytesIO()
    Image.fromarray(rgba).save(data, format="png")
    return data.getvalue()
