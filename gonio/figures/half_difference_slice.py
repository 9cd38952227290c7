"""f over half and difference angle, at a difference azimuth of 90°: the slice that sorts materials."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from gonio.figures.hemisphere import MAP, NO_VALUE, Scale, colour_range, colours, decade_levels
from gonio.figures.style import colour_bar
from gonio.figures.ticks import decades_between, degree_axis, root_degree_axis, sr_label
from gonio.models.geometry.directions import Direction

HALF = np.linspace(0, math.sqrt(90), 73) ** 2
DIFFERENCE = np.linspace(0, 89.5, 61)
"""Degrees; the half angle in even steps of its square root, as highlights are narrow."""
SHOWN = 80.0
"""Degrees of half and difference angle up to which values set the colour scale."""


def slice_pairs() -> tuple[Direction, Direction]:
    """(wi, wo) of the slice at phi_d = 90°, phi_h = 0: components of shape (len(HALF) * len(DIFFERENCE),).

    Both are above the horizon everywhere: their z is cos theta_h cos theta_d.
    """
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
    root_degree_axis(ax.xaxis)
    degree_axis(ax.yaxis)
    ax.set(xlabel="θh (half angle)", ylabel="θd (difference angle)")
    low, high = np.log10(scale)
    bar = colour_bar(ax, ScalarMappable(Normalize(low, high), MAP), "f / sr⁻¹")
    ticks = [t for t in decades_between(*scale) if low - 1e-9 <= math.log10(t) <= high + 1e-9]
    if len(ticks) < 3:
        ticks = (10 ** np.linspace(low, high, 4)).tolist()
    bar.set_ticks([math.log10(t) for t in ticks], labels=[sr_label(float(f"{t:.2g}")) for t in ticks])
