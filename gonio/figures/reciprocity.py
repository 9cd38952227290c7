"""f(wi, wo) against f(wo, wi), equal where a surface is reciprocal, and p-values of reciprocity over angles."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import FuncFormatter

from gonio.figures.style import AXIS_GREY, INK, MARK_BLACK, MARK_WHITE, colour_bar
from gonio.figures.ticks import decades_between, degree_axis, fixed_ticks, mantissa_ticks, sr_label

SCATTER_SIZE = (4.3, 3.9)


def draw_reciprocity(ax: Axes, a: np.ndarray, b: np.ndarray, tolerance: float | None, colour: str) -> None:
    """Pairs (n,), 1/sr, both positive, on logarithmic axes; the band is where 2|a−b|/(|a|+|b|) ≤ tolerance."""
    both = np.concatenate([a, b])
    low, high = (float(both.min()) / 1.25, float(both.max()) * 1.25) if both.size else (0.1, 1.0)
    low = max(low, high * 1e-7)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_aspect("equal")
    ends = np.array([low, high])
    if tolerance is not None and 0 < tolerance < 2:
        ratio = (2 + tolerance) / (2 - tolerance)
        ax.fill_between(ends, ends / ratio, ends * ratio, color=AXIS_GREY, alpha=0.25, lw=0)
    ax.plot(ends, ends, color=AXIS_GREY, lw=0.8)
    ax.plot(a, b, "o", ms=2.6, mec="none", mfc=colour, alpha=0.5, rasterized=True)
    ticks = [t for t in decades_between(low, high) if low <= t <= high]
    if len(ticks) < 2:
        ticks = mantissa_ticks(low, high, (1, 2, 5) if high / low > 3 else (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8))
    for axis in (ax.xaxis, ax.yaxis):
        fixed_ticks(axis, ticks)
    ax.set(xlim=(low, high), ylim=(low, high), xlabel="f(ωᵢ, ωₒ) / sr⁻¹", ylabel="f(ωₒ, ωᵢ) / sr⁻¹")


def draw_p_values(ax: Axes, theta: np.ndarray, p: np.ndarray, level: float) -> None:
    """p-values (n, n) of squares of both polar angles, degrees; the line on the colour bar is the level."""
    step = float(np.diff(theta)[0]) if theta.size > 1 else 10.0
    low, high = theta[0] - step / 2, theta[-1] + step / 2
    floor = level / 1e4
    norm = LogNorm(floor, 1.0)
    image = ax.imshow(
        np.ma.masked_invalid(np.clip(p, floor, 1.0)), extent=(low, high, low, high), origin="lower",
        cmap="cividis", norm=norm, interpolation="none",
    )  # fmt: skip
    for (row, column), value in np.ndenumerate(p):
        if np.isfinite(value):
            bright = norm(max(value, floor)) > 0.55
            ax.text(
                float(theta[column]), float(theta[row]), _short(value, floor), ha="center", va="center", fontsize=7.5,
                color=MARK_BLACK if bright else MARK_WHITE, weight="bold" if value < level else "normal",
            )  # fmt: skip
    bar = colour_bar(ax, image, f"p-value (line: level {level:g})", extend="min")
    bar.ax.axhline(level, color=INK, lw=1.4)
    bar.ax.minorticks_off()
    bar.set_ticks([10.0**e for e in range(math.ceil(math.log10(floor)), 1)])
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: sr_label(v)))
    for axis in (ax.xaxis, ax.yaxis):
        degree_axis(axis, np.arange(math.floor(low / 10) * 10, high + 1, 10))
    ax.set(xlabel="one polar angle", ylabel="the other")


def _short(p: float, floor: float) -> str:
    if p < floor:
        return f"<{sr_label(floor)}"
    return f"{p:.2f}".lstrip("0") if p >= 0.01 else sr_label(float(f"{p:.0e}"))
