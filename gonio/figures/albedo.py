"""Directional albedo against the angle of incidence, each with the bound on its error."""

import dataclasses

import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter

from gonio.figures.style import Picture, height_for, legend_above, panel, shades, styled


@dataclasses.dataclass(frozen=True)
class AlbedoCurve:
    """Albedo (n,) at incidences (n,), degrees, with bounds (n,), where infinite means that there is none."""

    theta_i: np.ndarray
    albedo: np.ndarray
    bound: np.ndarray
    label: str
    colour: str
    marker: str | None = None
    dash: object = "-"


def albedo_figure(curves: list[AlbedoCurve], label: str) -> Picture:
    """All curves in one panel; a band is value ± bound, and 1 is drawn as the most that can be reflected."""
    with styled():
        fig, ax = panel(height=height_for([c.label for c in curves]))
        ax.axhline(1.0, color="#8a8a8a", lw=0.8, ls=(0, (4, 2)))
        top, cap = 1.05, 3.0
        for c in curves:
            held = np.isfinite(c.bound)
            ax.fill_between(
                c.theta_i, np.where(held, c.albedo - c.bound, np.nan), np.where(held, c.albedo + c.bound, np.nan),
                color=c.colour, alpha=0.16, lw=0,
            )  # fmt: skip
            ax.plot(c.theta_i, c.albedo, color=c.colour, ls=c.dash, marker=c.marker, ms=3, label=c.label)
            finite = c.albedo[np.isfinite(c.albedo)]
            if finite.size:
                # A grid that misses a lobe may read any albedo from it: a few such places do not set the scale.
                cap = max(cap, 1.5 * float(np.median(finite)))
                top = max(top, 1.05 * float(finite.max()))
        ax.set(xlim=(0, 90), ylim=(0, min(top, cap)), xlabel="θᵢ", ylabel="directional albedo")
        ax.xaxis.set_major_locator(FixedLocator(range(0, 91, 15)))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}°"))
        ax.grid(axis="y")
        legend_above(ax)
        return Picture(fig, label)


def channel_colours(colour: str, names: tuple[str, ...]) -> list[str]:
    """A colour for each channel: red, green and blue as readers expect, else shades of the subject's colour."""
    if names == ("R", "G", "B"):
        return ["#D55E00", "#009E73", "#0072B2"]
    return shades(colour, len(names))
