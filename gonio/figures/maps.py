"""Maps of f: over the outgoing hemisphere seen from above, and over half and difference angle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gonio.figures import style
from gonio.figures.style import positive_range
from gonio.models.deferred import deferred
from gonio.text import sr_label

if TYPE_CHECKING:
    import matplotlib
    from matplotlib import cm, colors, patches
    from matplotlib.axes import Axes
else:
    matplotlib = deferred("matplotlib")
    cm = deferred("matplotlib.cm")
    colors = deferred("matplotlib.colors")
    patches = deferred("matplotlib.patches")

if TYPE_CHECKING:
    from gonio.models.geometry.directions import Direction

SIDE = 121
"""Pixels along a map's diameter: about 1° each at the pole."""
MAP = "viridis"
NO_VALUE, DOT_GREY = "#e4e4e4", "#9a9a9a"
MAP_SIZE = (2.75, 2.75)
SCALE_SIZE = (4.9, 0.62)

Scale = tuple[float, float]
"""Lowest and highest value, 1/sr, of a logarithmic colour scale."""


def disc_points(side: int = SIDE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(inside, theta_o, delta_phi): the side × side pixel centres above the horizon, and their directions.

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


def colour_range(values: np.ndarray) -> Scale:
    """The colour scale for all the maps of a subject."""
    return positive_range(values, 1.2, 1.1)


def decade_levels(values: np.ndarray, scale: Scale) -> np.ndarray:
    """Place of positive values on the logarithmic scale, 0 at its low end and 1 at its high; NaN for all others."""
    low, high = np.log10(scale)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (np.log10(np.where(values > 0, values, np.nan)) - low) / (high - low)


def colours(values: np.ndarray, scale: Scale) -> np.ndarray:
    """RGBA bytes of values, 1/sr: grey where they are not positive, blank where there are none (NaN)."""
    rgba = matplotlib.colormaps[MAP](np.clip(np.nan_to_num(decade_levels(values, scale)), 0, 1), bytes=True)
    rgba[values <= 0] = [*bytes.fromhex(NO_VALUE[1:]), 255]
    rgba[np.isnan(values)] = 0
    return rgba


def draw_map(ax: Axes, values: np.ndarray, scale: Scale, theta_i: float, behind: bool = False) -> None:
    """A map of pixels: `values`, 1/sr, at the points of `disc_points`; theta_i in degrees for the marks.

    `behind`: values are those of the light that goes through, as seen through the sample from the light's side.
    """
    inside, _, _ = disc_points()
    rgba = np.full((*inside.shape, 4), [255, 255, 255, 0], np.uint8)
    rgba[inside] = colours(values, scale)
    ax.imshow(rgba, extent=(-1, 1, -1, 1), interpolation="none")
    _draw_marks(ax, theta_i, style.MARK_WHITE, behind)


def draw_dots(
    ax: Axes,
    theta_o: np.ndarray,
    delta_phi: np.ndarray,
    f: np.ndarray,
    scale: Scale,
    theta_i: float,
    behind: bool = False,
) -> None:
    """A map of readings (n,), each a dot where it was measured; all angles in degrees, theta_o from its normal."""
    x, y = on_disc(np.radians(theta_o), np.radians(delta_phi))
    positive = f > 0
    level = np.clip(decade_levels(f[positive], scale), 0, 1)
    size = float(np.clip(9000 / max(f.size, 1), 1.5, 22))
    options = {"s": size, "lw": 0, "rasterized": f.size > 300}
    ax.scatter(x[~positive], y[~positive], color=DOT_GREY, **options)
    ax.scatter(x[positive], y[positive], c=level, cmap=MAP, vmin=0, vmax=1, **options)
    _draw_marks(ax, theta_i, DOT_GREY, behind)


def _draw_marks(ax: Axes, theta_i: float, line: str, behind: bool) -> None:
    ax.set_aspect("equal")
    ax.axis("off")
    ax.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    for theta in (30, 60):
        ax.add_patch(
            patches.Circle(
                (0, 0), math.sqrt(2) * math.sin(math.radians(theta / 2)), fill=False, ec=line, lw=0.6, alpha=0.7
            )
        )
    ax.add_patch(patches.Circle((0, 0), 1, fill=False, ec="#555555", lw=0.9))
    for text, x, y in (("0°", -1.12, 0), ("180°", 1.16, 0), ("90°", 0, -1.1), ("270°", 0, 1.1)):
        ax.text(x, y, text, ha="center", va="center", fontsize=8.5)
    t = math.radians(theta_i)
    (light, _), (mirror, _) = (on_disc(np.array(t), np.array(p)) for p in (0.0, math.pi))
    edge = {"mec": style.MARK_BLACK, "zorder": 5, "ls": "none"}
    if not behind:
        ax.plot(light, 0, "o", ms=6.5, mfc=style.MARK_WHITE, mew=0.9, **edge)
    ax.plot(mirror, 0, "+", ms=9, mew=2.6, mec=style.MARK_WHITE, zorder=5)
    ax.plot(mirror, 0, "+", ms=8, mew=1.0, mec=style.MARK_BLACK, zorder=6)
    ax.set_title(f"θᵢ = {theta_i:g}°" + ", through" * behind, pad=1)


def draw_scale(ax: Axes, scale: Scale) -> None:
    """The one colour bar of a row of maps: f, 1/sr, logarithmic."""
    low, high = np.log10(scale)
    ticks = style.decades_between(*scale)
    if high - low < 0.5:
        ticks = (10 ** np.linspace(low, high, 4)).tolist()
    elif high - low < 1.6:
        ticks = style.mantissa_ticks(scale[0] * (1 - 1e-9), scale[1] * (1 + 1e-9), (1, 2, 3, 5))
    ramp = matplotlib.colormaps[MAP](np.linspace(0, 1, 128), bytes=True)[None]
    ax.imshow(ramp, extent=(low, high, 0, 1), aspect="auto", interpolation="none")
    shown = [t for t in ticks if low - 1e-9 <= math.log10(t) <= high + 1e-9]
    ax.set_xticks([math.log10(t) for t in shown], [sr_label(float(f"{t:.3g}")) for t in shown])
    ax.set_yticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.set_xlabel("f / sr⁻¹")


HALF = np.linspace(0, math.sqrt(90), 73) ** 2
DIFFERENCE = np.linspace(0, 89.5, 61)
"""Degrees; the half angle in even steps of its square root, as highlights are narrow."""
SHOWN = 80.0
"""Degrees of half and difference angle up to which values set the colour scale."""


def slice_pairs() -> "tuple[Direction, Direction]":
    """(wi, wo) of the slice at phi_d = 90°, phi_h = 0: components of shape (len(HALF) * len(DIFFERENCE),).

    Both are above the horizon everywhere: their z is cos theta_h cos theta_d.
    """
    from gonio.models.geometry.directions import Direction  # loads JAX, which no picture needs

    h, d = (np.radians(a).ravel() for a in np.meshgrid(np.minimum(HALF, 89.9), DIFFERENCE, indexing="ij"))
    # About the half vector (0, ±sin d, cos d), turned by theta_h about the y axis.
    x, y, z = np.sin(h) * np.cos(d), np.sin(d), np.cos(h) * np.cos(d)
    return Direction(x, y, z), Direction(x, -y, z)


def slice_range(values: Sequence[np.ndarray]) -> Scale:
    """The colour scale of slices, by what is not near grazing, where all surfaces are mirrors."""
    inner = ((HALF <= SHOWN)[:, None] & (DIFFERENCE <= SHOWN)).ravel()
    return colour_range(np.concatenate([f[inner] for f in values]))


def draw_slice(ax: Axes, f: np.ndarray, scale: Scale) -> None:
    """`f`, 1/sr, at `slice_pairs`, in logarithmic colours of the scale."""
    values = f.reshape(len(HALF), len(DIFFERENCE)).T
    extent = (0, math.sqrt(90), 0, 90)
    ax.imshow(colours(values, scale), extent=extent, origin="lower", aspect="auto", interpolation="none")
    _draw_axes(ax, scale)


def draw_slice_readings(ax: Axes, theta_h: np.ndarray, theta_d: np.ndarray, f: np.ndarray, scale: Scale) -> None:
    """Readings (n,), 1/sr, as dots at their half and difference angles, degrees; grey where not positive."""
    x, positive = np.sqrt(theta_h), f > 0
    ax.scatter(x[~positive], theta_d[~positive], s=6, lw=0, color=NO_VALUE)
    level = np.clip(decade_levels(f[positive], scale), 0, 1)
    ax.scatter(x[positive], theta_d[positive], s=6, lw=0, c=level, cmap=MAP, vmin=0, vmax=1)
    ax.set(xlim=(0, math.sqrt(90)), ylim=(0, 90))
    _draw_axes(ax, scale)


def _draw_axes(ax: Axes, scale: Scale) -> None:
    style.root_degree_axis(ax.xaxis)
    style.degree_axis(ax.yaxis)
    ax.set(xlabel="θh (half angle)", ylabel="θd (difference angle)")
    low, high = np.log10(scale)
    bar = style.colour_bar(ax, cm.ScalarMappable(colors.Normalize(low, high), MAP), "f / sr⁻¹")
    ticks = [t for t in style.decades_between(*scale) if low - 1e-9 <= math.log10(t) <= high + 1e-9]
    if len(ticks) < 3:
        ticks = (10 ** np.linspace(low, high, 4)).tolist()
    bar.set_ticks([math.log10(t) for t in ticks], labels=[sr_label(float(f"{t:.2g}")) for t in ticks])
