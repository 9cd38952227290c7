"""The lobe over the outgoing hemisphere as a surface in space; the page's script turns the same mesh by hand."""

import math

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from gonio.figures.hemisphere import MAP
from gonio.figures.style import AXIS_GREY, FAINT, INK

SIZE = (4.9, 3.2)
TURN, TILT = 35.0, 22.0
"""Direction of the eye at first: degrees about the normal from the plane of incidence, and above the surface."""

AROUND = (-12.0, -6.0, -3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0, 6.0, 12.0)
DECADES = 5.0


def mesh_angles(theta_i: float) -> tuple[np.ndarray, np.ndarray]:
    """(theta_o, delta_phi), degrees: nodes of the mesh, closer together around the mirror direction of theta_i."""
    near = np.array(AROUND)
    # As many nodes whatever the incidence: one compiled program evaluates all.
    theta = np.sort(np.concatenate([np.linspace(0, 89.5, 25), np.clip(theta_i + near, 0.01, 89.4)]))
    phi = np.sort(np.concatenate([np.arange(0, 360, 10.0), 180 + near * 1.3 + 0.01, [360.0]]))
    return theta, phi


def levels(f: np.ndarray, high: float, log: bool) -> np.ndarray:
    """Radii in [0, 1]: f over its largest value, or its logarithm over `DECADES` below that; else 0."""
    shown = np.isfinite(f) & (f > 0)
    share = np.where(shown, f, 0.0) / high
    if not log:
        return share
    return np.where(shown, np.clip(1 + np.log10(np.maximum(share, 1e-300)) / DECADES, 0, 1), 0.0)


def projected(points: np.ndarray, turn: float, tilt: float) -> np.ndarray:
    """(right, up, towards the eye) of points (..., 3), the eye turned about the normal and tilted, degrees."""
    a, t = math.radians(turn), math.radians(tilt)
    x, y, z = np.moveaxis(points, -1, 0)
    right = x * math.cos(a) + y * math.sin(a)
    away = -x * math.sin(a) + y * math.cos(a)
    return np.stack([right, z * math.cos(t) + away * math.sin(t), z * math.sin(t) - away * math.cos(t)], axis=-1)


def draw_lobe(ax: Axes, theta_i: float, f: np.ndarray, high: float, log: bool) -> None:
    """The lobe at one incidence, degrees, the radius logarithmic or not.

    `f`, 1/sr, (theta_o, delta_phi) at `mesh_angles`; `high` is the value of radius 1.
    """
    theta, phi = (np.radians(a) for a in mesh_angles(theta_i))
    r = levels(f, high, log)
    # The light stands on the left: delta_phi = 0 is −x.
    x, y = (-np.sin(theta)[:, None] * a for a in (np.cos(phi), np.sin(phi)))
    unit = np.stack([x, y, np.cos(theta)[:, None] + 0 * phi], axis=-1)
    p = projected(r[..., None] * unit, TURN, TILT)
    quads = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    level = (r[:-1, :-1] + r[1:, 1:]).ravel() / 2
    order = np.argsort(quads[..., 2].mean(axis=1))
    ax.set_aspect("equal")
    ax.axis("off")
    ax.set(xlim=(-1.1, 1.1), ylim=(-0.46, 1.02))
    ring = np.linspace(0, 2 * np.pi, 121)
    base = projected(np.stack([np.cos(ring), np.sin(ring), 0 * ring], -1), TURN, TILT)
    ax.plot(base[:, 0], base[:, 1], color=AXIS_GREY, lw=0.8)
    axis = projected(np.array([[-1.0, 0, 0], [1.0, 0, 0]]), TURN, TILT)
    ax.plot(axis[:, 0], axis[:, 1], color=AXIS_GREY, lw=0.6, ls=(0, (3, 2)))
    faces = PolyCollection(
        list(quads[order][..., :2]), facecolors=colormaps[MAP](level[order]), edgecolors="face", lw=0.3, rasterized=True
    )
    ax.add_collection(faces)
    t = math.radians(theta_i)
    x, y, _ = projected(np.array([-math.sin(t), 0, math.cos(t)]), TURN, TILT)
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.1, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", xy=(0.72 * x, 0.72 * y), xytext=(x, y), arrowprops=arrow)
    words = f"θᵢ = {theta_i:.4g}°, radius: " + (f"log f, {DECADES:.0f} decades" if log else "f")
    ax.text(-1.08, -0.44, words, color=FAINT, fontsize=9)
