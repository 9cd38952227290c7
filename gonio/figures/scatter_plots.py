"""f in the plane of incidence against |sinθs − sinθi|, log-log, with fitted laws."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gonio.figures import style
from gonio.figures.reading_plots import Points
from gonio.figures.style import log_axis, positive_range
from gonio.models.deferred import deferred

if TYPE_CHECKING:
    from matplotlib import ticker
    from matplotlib.axes import Axes
else:
    ticker = deferred("matplotlib.ticker")


@dataclasses.dataclass(frozen=True)
class LawCurve:
    """A fitted law f(x), 1/sr, at offsets x (n,)."""

    x: np.ndarray
    f: np.ndarray
    label: str
    dashes: str


def draw_scatter(ax: Axes, points: Sequence[Points], laws: Sequence[LawCurve]) -> None:
    """f of each incidence over |sinθs − sinθi|, and the laws' curves."""
    x, f = (np.concatenate([getattr(p, name) for p in points]) for name in ("x", "f"))
    log_axis(ax, *positive_range(f, 2.0, 1.5))
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
    ax.xaxis.set_minor_formatter(ticker.NullFormatter())
    ax.set_xlim(x.min() / 1.3, x.max() * 1.3)
    ax.grid(axis="both")
    for p in points:
        style.draw_dots(ax, p.x, p.f, p.colour)
        ax.plot([], [], "o", ms=2.9, color=p.colour, mew=0, label=p.label, ls="none")
    for law in laws:
        ax.plot(law.x, law.f, law.dashes, color=style.INK, lw=1.0, label=law.label)
    ax.set_xlabel("|sinθₛ − sinθᵢ|")
    ax.set_ylabel("f / sr⁻¹")
    style.legend_above(ax)
