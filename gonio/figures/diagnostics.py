"""Diagnostic panels: albedo with its bound, reciprocity and its p-values, residuals and correlations of a fit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gonio.checks.certificate import Property
from gonio.data.channels import Channels
from gonio.figures import style
from gonio.models.deferred import deferred
from gonio.text import sr_label

if TYPE_CHECKING:
    from matplotlib import colors, ticker
    from matplotlib.axes import Axes
else:
    colors = deferred("matplotlib.colors")
    ticker = deferred("matplotlib.ticker")

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
    dash: style.Dash = "-"


def draw_albedo(ax: Axes, curves: Sequence[AlbedoCurve]) -> None:
    """All curves on one pair of axes; a band is value ± bound, and the line at 1 is the most that can be reflected."""
    ax.axhline(1.0, color=style.AXIS_GREY, lw=0.8, ls=(0, (4, 2)))
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
    style.degree_axis(ax.xaxis)
    ax.grid(axis="y")
    style.legend_above(ax)


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
    names = energy.facts.get("of_channels") or (channels.names if len(albedo) == len(channels) else ("grey",))
    return AlbedoSeries(theta, albedo, bound, tuple(names))


def channel_colours(colour: str, names: Sequence[str]) -> list[str]:
    """A colour for each channel: red, green and blue as readers expect, else shades of the subject's colour."""
    if tuple(names) == ("R", "G", "B"):
        return ["#D55E00", "#009E73", "#0072B2"]
    return style.shades(colour, len(names))


CORRELATIONS_SIZE = (4.9, 4.1)
NAMED = 30
"""Names of more parameters than these have no room."""
WRITTEN = 12
"""Rows of which the values themselves are written."""


def draw_correlations(ax: Axes, names: Sequence[str], correlation: np.ndarray) -> None:
    """Correlations (n, n), NaN where a parameter is undetermined; blue −1, red +1."""
    n = len(names)
    image = ax.imshow(
        np.ma.masked_invalid(correlation), cmap="RdBu_r", norm=colors.Normalize(-1, 1), interpolation="none"
    )  # fmt: skip
    if n <= NAMED:
        ax.set_xticks(range(n), names, rotation=90, fontsize=min(8.5, 160 / n))
        ax.set_yticks(range(n), names, fontsize=min(8.5, 160 / n))
    else:
        ax.set(xlabel=f"{n} numbers", ylabel=f"{n} numbers")
    for (row, column), value in np.ndenumerate(correlation if n <= WRITTEN else np.empty((0, 0))):
        if np.isfinite(value):
            text = f"{value:.2f}".replace("-", "−").replace("0.", ".")
            colour = style.MARK_WHITE if abs(value) > 0.65 else style.MARK_BLACK
            ax.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
    style.colour_bar(ax, image, "correlation")


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
        ax.fill_between(ends, ends / ratio, ends * ratio, color=style.AXIS_GREY, alpha=0.25, lw=0)
    ax.plot(ends, ends, color=style.AXIS_GREY, lw=0.8)
    ax.plot(a, b, "o", ms=2.6, mec="none", mfc=colour, alpha=0.5, rasterized=True)
    ticks = [t for t in style.decades_between(low, high) if low <= t <= high]
    if len(ticks) < 2:
        ticks = style.mantissa_ticks(low, high, (1, 2, 5) if high / low > 3 else (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8))
    for axis in (ax.xaxis, ax.yaxis):
        style.fixed_ticks(axis, ticks)
    ax.set(xlim=(low, high), ylim=(low, high), xlabel="f(ωᵢ, ωₒ) / sr⁻¹", ylabel="f(ωₒ, ωᵢ) / sr⁻¹")


def draw_p_values(ax: Axes, theta: np.ndarray, p: np.ndarray, level: float) -> None:
    """p-values (n, n) of squares of both polar angles, degrees; the line on the colour bar is the level."""
    step = float(np.diff(theta).min()) if theta.size > 1 else 10.0
    # Bands without readings are missing in theta; in the picture they are empty.
    place = np.rint((theta - theta[0]) / step).astype(int)
    squares = np.full((place[-1] + 1, place[-1] + 1), np.nan)
    squares[np.ix_(place, place)] = p
    low, high = theta[0] - step / 2, theta[-1] + step / 2
    floor = level / 1e4
    norm = colors.LogNorm(floor, 1.0)
    image = ax.imshow(
        np.ma.masked_invalid(np.clip(squares, floor, 1.0)), extent=(low, high, low, high), origin="lower",
        cmap="cividis", norm=norm, interpolation="none",
    )  # fmt: skip
    for (row, column), value in np.ndenumerate(p):
        if np.isfinite(value):
            bright = norm(max(value, floor)) > 0.55
            ax.text(
                float(theta[column]), float(theta[row]), _short(value, floor), ha="center", va="center", fontsize=7.5,
                color=style.MARK_BLACK if bright else style.MARK_WHITE, weight="bold" if value < level else "normal",
            )  # fmt: skip
    bar = style.colour_bar(ax, image, f"p-value (line: level {level:g})", extend="min")
    bar.ax.axhline(level, color=style.INK, lw=1.4)
    bar.ax.minorticks_off()
    bar.set_ticks([10.0**e for e in range(math.ceil(math.log10(floor)), 1)])
    bar.ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda v, _: sr_label(v)))
    for axis in (ax.xaxis, ax.yaxis):
        style.degree_axis(axis, np.arange(math.floor(low / 10) * 10, high + 1, 10))
    ax.set(xlabel="one polar angle", ylabel="the other")


def _short(p: float, floor: float) -> str:
    if p < floor:
        return f"<{sr_label(floor)}"
    return f"{p:.2f}".lstrip("0") if p >= 0.01 else sr_label(float(f"{p:.0e}"))


BINS = 30
ABOUT_NODES = np.concatenate([[0.0], np.arange(2.5, 88, 5.0), [90.0]])
"""Edges of bins that have the usual nodes of a grid, every 5°, in their middle."""
NAMES = {
    "theta_h": "θh (half angle)",
    "theta_d": "θd (difference angle)",
    "theta_i": "θi (incidence)",
    "theta_o": "θo (outgoing)",
}


class MedianGrid(NamedTuple):
    """Edges across and up, degrees, and the medians between them, %; NaN where there is no residual."""

    x_edges: np.ndarray
    y_edges: np.ndarray
    median: np.ndarray


def median_grid(across: np.ndarray, up: np.ndarray, relative: np.ndarray, root: bool) -> MedianGrid:
    """Medians of (model − reading)/|reading| by two angles, degrees; `root`: even steps of the first one's root."""
    from gonio.fitting.residuals.maps import bins, grouped_median  # loads JAX, which no picture needs

    x_edges = np.linspace(0, np.sqrt(90), BINS + 1) ** 2 if root else _about_nodes(across)
    y_edges = np.linspace(0, 90, BINS + 1) if root else _about_nodes(up)
    rows, columns = x_edges.size - 1, y_edges.size - 1
    cell = bins(across, x_edges) * columns + bins(up, y_edges)
    return MedianGrid(x_edges, y_edges, grouped_median(cell, 100 * relative, rows * columns).reshape(rows, columns))


def _about_nodes(angles: np.ndarray) -> np.ndarray:
    """Edges of bins up to the horizon, or on behind the sample."""
    if angles.max(initial=0.0) <= 90:
        return ABOUT_NODES
    return np.concatenate([ABOUT_NODES, 180 - ABOUT_NODES[-2::-1]])


def residual_limit(grids: Sequence[MedianGrid]) -> float:
    """The end, %, of one colour scale for maps of residuals: by the smallest, and no less than a tenth of the largest.

    What exceeds it is cut off: by the worst of several fits the others would look faultless.
    """
    finite = [np.abs(g.median[np.isfinite(g.median)]) for g in grids]
    ends = [float(np.clip(np.percentile(f, 95), 0.01, 100)) for f in finite if f.size]
    return max(min(ends), max(ends) / 10) if ends else 1.0


def draw_residual_map(ax: Axes, grid: MedianGrid, axes: tuple[str, str], limit: float | None = None) -> None:
    """Medians of relative residuals by two angles in colour up to a limit, %; the half angle on a square-root scale."""
    root = axes[0] == "theta_h"
    limit = residual_limit([grid]) if limit is None else limit
    mesh = ax.pcolormesh(
        np.sqrt(grid.x_edges) if root else grid.x_edges, grid.y_edges, grid.median.T, cmap="RdBu_r",
        norm=colors.CenteredNorm(halfrange=limit), rasterized=True,
    )  # fmt: skip
    style.colour_bar(ax, mesh, "median of (model − reading)/|reading|, %", extend="both")
    for axis, edges in ((ax.xaxis, grid.x_edges), (ax.yaxis, grid.y_edges)):
        if root and axis is ax.xaxis:
            style.root_degree_axis(axis)
        elif edges[-1] > 90:
            style.degree_axis(axis, range(0, 181, 30))
        else:
            style.degree_axis(axis)
    ax.set(xlabel=NAMES[axes[0]], ylabel=NAMES[axes[1]])


def draw_residual_histogram(ax: Axes, values: np.ndarray, in_sigma: bool, colour: str) -> None:
    """Distribution of residuals: relative, %, or in standard uncertainties beside the standard normal of noise."""
    edges, density = residual_density(values, in_sigma)
    ax.stairs(density, edges, fill=True, color=colour, alpha=0.55)
    if in_sigma:
        x = np.linspace(-5, 5, 201)
        ax.plot(x, np.exp(-x * x / 2) / np.sqrt(2 * np.pi), color=style.INK, lw=1.1, label="noise alone")
        ax.legend(loc="upper right")
    ax.set(xlim=(edges[0], edges[-1]), ylabel="share of readings per unit", ylim=(0, None))
    ax.set_xlabel("(model − reading) / u(f)" if in_sigma else "(model − reading)/reading, %")
    ax.grid(axis="y")


def residual_density(values: np.ndarray, in_sigma: bool) -> tuple[np.ndarray, np.ndarray]:
    """(edges, share of the values per unit in each bin) over ±5 uncertainties, or over 98 % of the sizes."""
    limit = 5.0 if in_sigma else max(float(np.percentile(np.abs(values), 98)), 1e-12)
    edges = np.linspace(-limit, limit, 61)
    return edges, np.histogram(values, edges)[0] / max(values.size, 1) / np.diff(edges)
