"""f(wi, wo) against f(wo, wi), which are the same where a surface is reciprocal; and p-values of that over angles."""

import math

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from gonio.figures.style import INK, Picture, panel, styled
from gonio.figures.ticks import decades_between, sr_label


def reciprocity_scatter(a: np.ndarray, b: np.ndarray, tolerance: float | None, colour: str, label: str) -> Picture:
    """Pairs (n,), 1/sr, both positive, on logarithmic axes; the band is where 2|a−b|/(|a|+|b|) ≤ tolerance."""
    both = np.concatenate([a, b])
    low, high = (float(both.min()) / 1.25, float(both.max()) * 1.25) if both.size else (0.1, 1.0)
    low = max(low, high * 1e-7)
    with styled():
        fig, ax = panel(4.3, 3.9)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_aspect("equal")
        ends = np.array([low, high])
        if tolerance is not None and 0 < tolerance < 2:
            ratio = (2 + tolerance) / (2 - tolerance)
            ax.fill_between(ends, ends / ratio, ends * ratio, color="#8a8a8a", alpha=0.25, lw=0)
        ax.plot(ends, ends, color="#8a8a8a", lw=0.8)
        ax.plot(a, b, "o", ms=2.6, mec="none", mfc=colour, alpha=0.5, rasterized=True)
        ticks = [t for t in decades_between(low, high) if low <= t <= high]
        if len(ticks) < 2:
            exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
            steps = (1, 2, 5) if high / low > 3 else (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8)
            ticks = [s * 10.0**e for e in exponents for s in steps if low <= s * 10.0**e <= high]
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(FixedLocator(ticks))
            axis.set_minor_locator(FixedLocator([]))
            axis.set_major_formatter(FuncFormatter(lambda v, _: sr_label(v)))
            axis.set_minor_formatter(NullFormatter())
        ax.set(xlim=(low, high), ylim=(low, high), xlabel="f(ωᵢ, ωₒ) / sr⁻¹", ylabel="f(ωₒ, ωᵢ) / sr⁻¹")
        return Picture(fig, label)


def p_map(theta: np.ndarray, p: np.ndarray, level: float, label: str) -> Picture:
    """p-values (n, n) of squares of both polar angles, degrees; the level is where the colour turns."""
    step = float(np.diff(theta)[0]) if theta.size > 1 else 10.0
    low, high = theta[0] - step / 2, theta[-1] + step / 2
    floor = level / 1e4
    with styled():
        fig, ax = panel()
        shown = np.ma.masked_invalid(np.clip(p, floor, 1.0))
        norm = LogNorm(floor, 1.0)
        image = ax.imshow(
            shown, extent=(low, high, low, high), origin="lower", cmap="cividis", norm=norm, interpolation="none"
        )
        for (row, column), value in np.ndenumerate(p):
            if np.isfinite(value):
                bright = norm(max(value, floor)) > 0.55
                ax.text(
                    theta[column], theta[row], _short(value, floor), ha="center", va="center", fontsize=7.5,
                    color="#010101" if bright else "#fefefe", weight="bold" if value < level else "normal",
                )  # fmt: skip
        bar = fig.colorbar(image, ax=ax, pad=0.02, aspect=28, extend="min")
        bar.solids.set_rasterized(True)
        bar.outline.set_visible(False)
        bar.ax.axhline(level, color=INK, lw=1.4)
        bar.ax.minorticks_off()
        bar.set_ticks([10.0**e for e in range(math.ceil(math.log10(floor)), 1)])
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: sr_label(v)))
        bar.set_label(f"p-value (line: level {level:g})")
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(FixedLocator(np.arange(math.floor(low / 10) * 10, high + 1, 10)))
            axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}°"))
        ax.set(xlabel="one polar angle", ylabel="the other")
        return Picture(fig, label)


def _short(p: float, floor: float) -> str:
    if p < floor:
        return f"<{sr_label(floor)}"
    return f"{p:.2f}".lstrip("0") if p >= 0.01 else sr_label(float(f"{p:.0e}"))
