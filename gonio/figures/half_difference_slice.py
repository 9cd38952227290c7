"""f over half and difference angle, at a difference azimuth of 90°: the slice that sorts materials."""

import math

import numpy as np
from matplotlib import colormaps
from matplotlib.ticker import FixedLocator, FuncFormatter

from gonio.figures.hemisphere import MAP, NOTHING
from gonio.figures.style import Picture, panel, styled
from gonio.figures.ticks import decades_between, sr_label

HALF = np.linspace(0, math.sqrt(90), 73) ** 2
DIFFERENCE = np.linspace(0, 89.5, 61)
"""Degrees; the half angle in even steps of its square root, as highlights are narrow."""


def slice_pairs() -> tuple[np.ndarray, np.ndarray]:
    """(wi, wo), each (3, len(HALF) * len(DIFFERENCE)): directions of the slice at phi_d = 90°, phi_h = 0.

    Both are above the horizon everywhere: their z is cos theta_h cos theta_d.
    """
    h, d = (np.radians(a).ravel() for a in np.meshgrid(np.minimum(HALF, 89.9), DIFFERENCE, indexing="ij"))
    pairs = []
    for sign in (1.0, -1.0):
        # About the half vector (0, ±sin d, cos d), turned by theta_h about the y axis.
        pairs.append(np.stack([np.sin(h) * np.cos(d), sign * np.sin(d), np.cos(h) * np.cos(d)]))
    return pairs[0], pairs[1]


def slice_figure(f: np.ndarray, scale: tuple[float, float], label: str) -> Picture:
    """`f`, 1/sr, at `slice_pairs`, in logarithmic colours from scale[0] to scale[1]."""
    low, high = (math.log10(s) for s in scale)
    values = f.reshape(len(HALF), len(DIFFERENCE)).T
    with np.errstate(divide="ignore", invalid="ignore"):
        level = (np.log10(np.where(values > 0, values, np.nan)) - low) / (high - low)
    rgba = colormaps[MAP](np.clip(np.nan_to_num(level), 0, 1), bytes=True)
    rgba[~(values > 0)] = [*bytes.fromhex(NOTHING[1:]), 255]
    with styled():
        fig, ax = panel()
        side = math.sqrt(90)
        ax.imshow(rgba, extent=(0, side, 0, 90), origin="lower", aspect="auto", interpolation="none")
        ax.xaxis.set_major_locator(FixedLocator(np.sqrt([0, 1, 5, 15, 30, 50, 75])))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v * v:.0f}°"))
        ax.yaxis.set_major_locator(FixedLocator(range(0, 91, 15)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}°"))
        ax.set(xlabel="θh (half angle)", ylabel="θd (difference angle)")
        _bar(fig, ax, low, high)
        return Picture(fig, label)


def _bar(fig, ax, low: float, high: float) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar = fig.colorbar(ScalarMappable(Normalize(low, high), MAP), ax=ax, pad=0.02, aspect=28)
    bar.solids.set_rasterized(True)
    bar.outline.set_visible(False)
    ticks = [t for t in decades_between(10**low, 10**high) if low - 1e-9 <= math.log10(t) <= high + 1e-9]
    if len(ticks) < 3:
        ticks = [10**v for v in np.linspace(low, high, 4)]
    bar.set_ticks([math.log10(t) for t in ticks], labels=[sr_label(float(f"{t:.2g}")) for t in ticks])
    bar.set_label("f / sr⁻¹")
