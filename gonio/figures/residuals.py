"""Residuals of a fit: their medians over two angles, and their distribution."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import CenteredNorm

from gonio.figures.style import INK, colour_bar
from gonio.figures.ticks import degree_axis, root_degree_axis
from gonio.fitting.residuals.maps import bins, grouped_median

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
    x_edges = np.linspace(0, np.sqrt(90), BINS + 1) ** 2 if root else ABOUT_NODES
    y_edges = np.linspace(0, 90, BINS + 1) if root else ABOUT_NODES
    rows, columns = x_edges.size - 1, y_edges.size - 1
    cell = bins(across, x_edges) * columns + bins(up, y_edges)
    return MedianGrid(x_edges, y_edges, grouped_median(cell, 100 * relative, rows * columns).reshape(rows, columns))


def draw_residual_map(ax: Axes, grid: MedianGrid, axes: tuple[str, str]) -> None:
    """Medians of relative residuals by two angles in colour; the half angle on a square-root scale."""
    root = axes[0] == "theta_h"
    finite = np.abs(grid.median[np.isfinite(grid.median)])
    limit = float(np.clip(np.percentile(finite, 95), 0.01, 100)) if finite.size else 1.0
    mesh = ax.pcolormesh(
        np.sqrt(grid.x_edges) if root else grid.x_edges, grid.y_edges, grid.median.T, cmap="RdBu_r",
        norm=CenteredNorm(halfrange=limit), rasterized=True,
    )  # fmt: skip
    colour_bar(ax, mesh, "median of (model − reading)/|reading|, %", extend="both")
    (root_degree_axis if root else degree_axis)(ax.xaxis)
    degree_axis(ax.yaxis)
    ax.set(xlabel=NAMES[axes[0]], ylabel=NAMES[axes[1]])


def draw_residual_histogram(ax: Axes, values: np.ndarray, in_sigma: bool, colour: str) -> None:
    """Distribution of residuals: relative, %, or in standard uncertainties beside the standard normal of noise."""
    edges, density = residual_density(values, in_sigma)
    ax.stairs(density, edges, fill=True, color=colour, alpha=0.55)
    if in_sigma:
        x = np.linspace(-5, 5, 201)
        ax.plot(x, np.exp(-x * x / 2) / np.sqrt(2 * np.pi), color=INK, lw=1.1, label="noise alone")
        ax.legend(loc="upper right")
    ax.set(xlim=(edges[0], edges[-1]), ylabel="share of readings per unit", ylim=(0, None))
    ax.set_xlabel("(model − reading) / u(f)" if in_sigma else "(model − reading)/reading, %")
    ax.grid(axis="y")


def residual_density(values: np.ndarray, in_sigma: bool) -> tuple[np.ndarray, np.ndarray]:
    """(edges, share of the values per unit in each bin) over ±5 uncertainties, or over 98 % of the sizes."""
    limit = 5.0 if in_sigma else max(float(np.percentile(np.abs(values), 98)), 1e-12)
    edges = np.linspace(-limit, limit, 61)
    return edges, np.histogram(values, edges)[0] / max(values.size, 1) / np.diff(edges)
