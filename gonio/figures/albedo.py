"""Directional albedo against the angle of incidence, each with the bound on its error."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from gonio.checks.certificate import Property
from gonio.data.table import Channels
from gonio.figures.style import AXIS_GREY, Dash, legend_above, shades
from gonio.figures.ticks import degree_axis

MOST_CURVES = 6


@dataclasses.dataclass(frozen=True)
class AlbedoCurve:
    """Albedo (n,) at incidences (n,), degrees, with bounds (n,); an infinite bound means that there is none."""

    theta_i: np.ndarray
    albedo: np.ndarray
    bound: np.ndarray
    label: str
    colour: str
    marker: str | None = None
    dash: Dash = "-"


def draw_albedo(ax: Axes, curves: Sequence[AlbedoCurve]) -> None:
    """All curves on one pair of axes; a band is value ± bound, and the line at 1 is the most that can be reflected."""
    ax.axhline(1.0, color=AXIS_GREY, lw=0.8, ls=(0, (4, 2)))
    top, cap = 1.05, 3.0
    for c in curves:
        bound = np.where(np.isfinite(c.bound), c.bound, np.nan)
        ax.fill_between(c.theta_i, c.albedo - bound, c.albedo + bound, color=c.colour, alpha=0.16, lw=0)
        ax.plot(c.theta_i, c.albedo, color=c.colour, ls=c.dash, marker=c.marker, ms=3, label=c.label)
        finite = c.albedo[np.isfinite(c.albedo)]
        if finite.size:
            # A grid that misses a lobe may give any albedo there: a few such places do not set the scale.
            cap = max(cap, 1.5 * float(np.median(finite)))
            top = max(top, 1.05 * float(finite.max()))
    ax.set(xlim=(0, 90), ylim=(0, min(top, cap)), xlabel="θᵢ", ylabel="directional albedo")
    degree_axis(ax.xaxis)
    ax.grid(axis="y")
    legend_above(ax)


class AlbedoSeries(NamedTuple):
    """Directional albedo and the bound on its error, (channels, n), at incidences (n,), degrees."""

    theta_i: np.ndarray
    albedo: np.ndarray
    bound: np.ndarray
    names: tuple[str, ...]

    def shown(self) -> np.ndarray:
        """Numbers of at most `MOST_CURVES` channels, evenly chosen."""
        return np.unique(np.linspace(0, len(self.names) - 1, min(len(self.names), MOST_CURVES)).astype(int))

    def curves(self, colour: str, marker: str | None) -> list[AlbedoCurve]:
        """A curve for each of the shown channels."""
        colours = channel_colours(colour, [self.names[k] for k in self.shown()])
        return [
            AlbedoCurve(self.theta_i, self.albedo[k], self.bound[k], self.names[k], c, marker)
            for k, c in zip(self.shown(), colours, strict=True)
        ]


def albedo_series(energy: Property, channels: Channels) -> AlbedoSeries | None:
    """The albedos of a certificate's energy property; None where it has none."""
    theta = np.asarray(energy.series.get("theta_i_deg", ()), float)
    if not theta.size:
        return None
    # None stands for NaN; of a single channel there may be one list without a channel axis.
    albedo, bound = (np.array(energy.series[k], float).reshape(-1, theta.size) for k in ("albedo", "bound"))
    return AlbedoSeries(theta, albedo, bound, channels.names if len(albedo) == len(channels) else ("grey",))


def channel_colours(colour: str, names: Sequence[str]) -> list[str]:
    """A colour for each channel: red, green and blue as readers expect, else shades of the subject's colour."""
    if tuple(names) == ("R", "G", "B"):
        return ["#D55E00", "#009E73", "#0072B2"]
    return shades(colour, len(names))
