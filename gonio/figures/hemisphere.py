"""Maps of f over the outgoing hemisphere, seen from above, in equal-area projection.

The radius is √2 sin(theta_o/2), so that equal areas are equal solid angles [Lambert 1772]. The light is on the
left, the mirror direction on the right, as in the plane-of-incidence pictures: delta_phi grows counter-clockwise
from the left.
"""

import math

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from gonio.figures.style import MARK_BLACK, MARK_WHITE, Picture, panel, styled
from gonio.figures.ticks import decades_between, sr_label

SIDE = 121
"""Pixels along a map's diameter: about 1° each at the pole."""
MAP = "viridis"
NOTHING = "#e4e4e4"
SIZE = 2.75


def disc_points(side: int = SIDE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(inside, theta_o, delta_phi): which of the side × side pixel centres are above the horizon, and where they look.

    `inside` has shape (side, side), rows from top to bottom; the angles, radians, the shape of its true pixels.
    """
    step = (np.arange(side) + 0.5) * 2 / side - 1
    x, y = np.meshgrid(step, -step)
    radius = np.hypot(x, y)
    inside = radius < 1
    return inside, 2 * np.arcsin(radius[inside] / math.sqrt(2)), np.arctan2(-y[inside], -x[inside]) % (2 * np.pi)


def on_disc(theta_o: np.ndarray, delta_phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(x, y) in the unit disc of outgoing directions, radians."""
    radius = math.sqrt(2) * np.sin(np.asarray(theta_o) / 2)
    return -radius * np.cos(delta_phi), -radius * np.sin(delta_phi)


def colour_range(values: np.ndarray, decades: float = 6.0) -> tuple[float, float]:
    """(low, high), 1/sr, of a logarithmic colour scale for all the maps of a subject."""
    positive = values[np.isfinite(values) & (values > 0)]
    if not positive.size:
        return 0.1, 1.0
    high = float(positive.max())
    low = max(float(positive.min()), high * 10**-decades)
    return (low, high) if high / low > 1.2 else (low / 1.1, high * 1.1)


def hemisphere_map(values: np.ndarray, scale: tuple[float, float], theta_i: float, label: str) -> Picture:
    """One map of pixels: `values`, 1/sr, at the points of `disc_points`; theta_i in degrees for the marks."""
    inside, _, _ = disc_points()
    image = np.full(inside.shape, np.nan)
    image[inside] = values
    low, high = (math.log10(s) for s in scale)
    with np.errstate(divide="ignore", invalid="ignore"):
        level = (np.log10(np.where(image > 0, image, np.nan)) - low) / (high - low)
    rgba = colormaps[MAP](np.clip(np.nan_to_num(level), 0, 1), bytes=True)
    rgba[inside & ~(image > 0)] = [*bytes.fromhex(NOTHING[1:]), 255]
    rgba[~inside] = [255, 255, 255, 0]
    with styled():
        fig, ax = panel(SIZE, SIZE)
        ax.imshow(rgba, extent=(-1, 1, -1, 1), interpolation="none")
        _furniture(ax, theta_i)
        return Picture(fig, label)


def hemisphere_dots(
    theta_o: np.ndarray,
    delta_phi: np.ndarray,
    values: np.ndarray,
    scale: tuple[float, float],
    theta_i: float,
    label: str,
) -> Picture:
    """One map of readings, each a dot where it was measured; radians, 1/sr."""
    low, high = (math.log10(s) for s in scale)
    with np.errstate(divide="ignore", invalid="ignore"):
        level = (np.log10(np.where(values > 0, values, np.nan)) - low) / (high - low)
    x, y = on_disc(theta_o, delta_phi)
    positive = values > 0
    size = float(np.clip(9000 / max(values.size, 1), 1.5, 22))
    with styled():
        fig, ax = panel(SIZE, SIZE)
        kind = {"s": size, "lw": 0, "rasterized": values.size > 300}
        ax.scatter(x[~positive], y[~positive], color="#9a9a9a", **kind)
        ax.scatter(x[positive], y[positive], c=np.clip(level[positive], 0, 1), cmap=MAP, vmin=0, vmax=1, **kind)
        _furniture(ax, theta_i, dark=True)
        return Picture(fig, label)


def _furniture(ax: Axes, theta_i: float, dark: bool = False) -> None:
    line = "#9a9a9a" if dark else MARK_WHITE
    ax.set_aspect("equal")
    ax.axis("off")
    ax.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    for theta in (30, 60):
        ax.add_patch(
            Circle((0, 0), math.sqrt(2) * math.sin(math.radians(theta / 2)), fill=False, ec=line, lw=0.6, alpha=0.7)
        )
    ax.add_patch(Circle((0, 0), 1, fill=False, ec="#555555", lw=0.9))
    for text, x, y in (("0°", -1.12, 0), ("180°", 1.16, 0), ("90°", 0, -1.1), ("270°", 0, 1.1)):
        ax.text(x, y, text, ha="center", va="center", fontsize=8.5)
    t = math.radians(theta_i)
    (light, _), (mirror, _) = (on_disc(np.array(t), np.array(p)) for p in (0.0, math.pi))
    edge = {"mec": MARK_BLACK, "zorder": 5, "ls": "none"}
    ax.plot(light, 0, "o", ms=6.5, mfc=MARK_WHITE, mew=0.9, **edge)
    ax.plot(mirror, 0, "+", ms=9, mew=2.6, mec=MARK_WHITE, zorder=5)
    ax.plot(mirror, 0, "+", ms=8, mew=1.0, mec=MARK_BLACK, zorder=6)
    ax.set_title(f"θᵢ = {theta_i:g}°", pad=1)


def colour_bar(scale: tuple[float, float], label: str) -> Picture:
    """The one colour bar of a row of maps: f, 1/sr, logarithmic."""
    low, high = (math.log10(s) for s in scale)
    ticks = decades_between(*scale)
    if high - low < 1.6:
        ticks = [m * 10.0**e for e in range(math.floor(low), math.ceil(high) + 1) for m in (1, 2, 3, 5)]
        if high - low < 0.5:
            ticks = [10**v for v in np.linspace(low, high, 4)]
    with styled():
        fig, ax = panel(4.9, 0.62)
        ramp = colormaps[MAP](np.linspace(0, 1, 128), bytes=True)[None]
        ax.imshow(ramp, extent=(low, high, 0, 1), aspect="auto", interpolation="none")
        shown = [t for t in ticks if low - 1e-9 <= math.log10(t) <= high + 1e-9]
        ax.set_xticks([math.log10(t) for t in shown], [sr_label(float(f"{t:.3g}")) for t in shown])
        ax.set_yticks([])
        ax.spines[["left", "bottom"]].set_visible(False)
        ax.set_xlabel("f / sr⁻¹")
        return Picture(fig, label)
