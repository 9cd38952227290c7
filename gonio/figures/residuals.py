"""What a fit leaves over: where it is, and how it is distributed."""

import numpy as np
from matplotlib.colors import CenteredNorm
from matplotlib.ticker import FixedLocator, FuncFormatter

from gonio.figures.style import INK, Picture, panel, styled
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


def median_grid(
    across: np.ndarray, up: np.ndarray, relative: np.ndarray, root: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(edges across, edges up, medians): of (model − reading)/|reading|, %, by two angles, degrees; NaN where empty.

    `root`: the first angle in even steps of its square root.
    """
    x_edges = np.linspace(0, np.sqrt(90), BINS + 1) ** 2 if root else ABOUT_NODES
    y_edges = np.linspace(0, 90, BINS + 1) if root else ABOUT_NODES
    rows, columns = x_edges.size - 1, y_edges.size - 1
    cell = bins(across, x_edges) * columns + bins(up, y_edges)
    return x_edges, y_edges, grouped_median(cell, 100 * relative, rows * columns).reshape(rows, columns)


def residual_map(
    x_edges: np.ndarray,
    y_edges: np.ndarray,
    medians: np.ndarray,
    label: str,
    axes: tuple[str, str] = ("theta_h", "theta_d"),
) -> Picture:
    """The medians of `median_grid` in colour; the half angle on a square-root scale."""
    root = axes[0] == "theta_h"
    finite = np.abs(medians[np.isfinite(medians)])
    limit = float(np.clip(np.percentile(finite, 95), 0.01, 100)) if finite.size else 1.0
    with styled():
        fig, ax = panel()
        mesh = ax.pcolormesh(
            np.sqrt(x_edges) if root else x_edges, y_edges, medians.T, cmap="RdBu_r",
            norm=CenteredNorm(halfrange=limit), rasterized=True,
        )  # fmt: skip
        bar = fig.colorbar(mesh, ax=ax, pad=0.02, aspect=28, extend="both")
        bar.set_label("median of (model − reading)/|reading|, %")
        bar.outline.set_visible(False)
        bar.solids.set_rasterized(True)
        if root:
            ax.xaxis.set_major_locator(FixedLocator(np.sqrt([0, 1, 5, 15, 30, 50, 75])))
            ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v * v:.0f}°"))
        for axis in (ax.yaxis,) if root else (ax.xaxis, ax.yaxis):
            axis.set_major_locator(FixedLocator(range(0, 91, 15)))
            axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}°"))
        ax.set(xlabel=NAMES[axes[0]], ylabel=NAMES[axes[1]])
        return Picture(fig, label)


def residual_histogram(values: np.ndarray, unit: str, colour: str, label: str) -> Picture:
    """How residuals are distributed; with `unit` "u_f" beside the standard normal that noise alone would give."""
    in_sigma = unit == "u_f"
    edges, counts = shares(values, in_sigma)
    limit = edges[-1]
    with styled():
        fig, ax = panel()
        ax.stairs(counts, edges, fill=True, color=colour, alpha=0.55)
        if in_sigma:
            x = np.linspace(-5, 5, 201)
            ax.plot(x, np.exp(-x * x / 2) / np.sqrt(2 * np.pi), color=INK, lw=1.1, label="noise alone")
            ax.legend(loc="upper right")
        ax.set(xlim=(-limit, limit), ylabel="share of readings per unit", ylim=(0, None))
        ax.set_xlabel("(model − reading) / u(f)" if in_sigma else "(model − reading)/reading, %")
        ax.grid(axis="y")
        return Picture(fig, label)


def shares(values: np.ndarray, in_sigma: bool) -> tuple[np.ndarray, np.ndarray]:
    """(edges, share of the values per unit in each bin) over ±5 uncertainties, or over 98 % of the sizes."""
    limit = 5.0 if in_sigma else max(float(np.percentile(np.abs(values), 98)), 1e-12)
    edges = np.linspace(-limit, limit, 61)
    return edges, np.histogram(values, edges)[0] / max(values.size, 1) / np.diff(edges)
