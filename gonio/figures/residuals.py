"""What a fit leaves over: where it is, and how it is distributed."""

import numpy as np
from matplotlib.colors import CenteredNorm
from matplotlib.ticker import FixedLocator, FuncFormatter

from gonio.figures.style import panel, styled, svg

BINS = 30


def residual_map(theta_h: np.ndarray, theta_d: np.ndarray, relative: np.ndarray, label: str) -> str:
    """Median of (model − reading)/reading over the half angle (√ scale) and the difference angle; degrees."""
    h_edges, d_edges = np.linspace(0, np.sqrt(90), BINS + 1) ** 2, np.linspace(0, 90, BINS + 1)
    rows = np.clip(np.searchsorted(h_edges, theta_h, side="right") - 1, 0, BINS - 1)
    columns = np.clip(np.searchsorted(d_edges, theta_d, side="right") - 1, 0, BINS - 1)
    medians = _medians(rows * BINS + columns, 100 * relative, BINS * BINS).reshape(BINS, BINS)
    finite = np.abs(medians[np.isfinite(medians)])
    limit = float(np.clip(np.percentile(finite, 95), 0.01, 100)) if finite.size else 1.0
    with styled():
        fig, ax = panel()
        mesh = ax.pcolormesh(
            np.sqrt(h_edges), d_edges, medians.T, cmap="RdBu_r", norm=CenteredNorm(halfrange=limit), rasterized=True
        )
        bar = fig.colorbar(mesh, ax=ax, pad=0.02, aspect=28, extend="both")
        bar.set_label("median of (model − reading)/reading, %")
        bar.outline.set_visible(False)
        ax.xaxis.set_major_locator(FixedLocator(np.sqrt([0, 1, 5, 15, 30, 50, 75])))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v * v:.0f}°"))
        ax.yaxis.set_major_locator(FixedLocator(range(0, 91, 15)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}°"))
        ax.set(xlabel="θh (half angle)", ylabel="θd (difference angle)")
        return svg(fig, label)


def _medians(group: np.ndarray, values: np.ndarray, groups: int) -> np.ndarray:
    found = np.full(groups, np.nan)
    order = np.argsort(group, kind="stable")
    ends = np.searchsorted(group[order], np.arange(groups + 1))
    for g in np.flatnonzero(np.diff(ends)):
        found[g] = np.median(values[order[ends[g] : ends[g + 1]]])
    return found


def residual_histogram(values: np.ndarray, unit: str, colour: str, label: str) -> str:
    """How residuals are distributed; with `unit` "u_f" beside the standard normal that noise alone would give."""
    in_sigma = unit == "u_f"
    limit = 5.0 if in_sigma else max(float(np.percentile(np.abs(values), 98)), 1e-12)
    edges = np.linspace(-limit, limit, 61)
    counts = np.histogram(values, edges)[0] / max(values.size, 1) / np.diff(edges)
    with styled():
        fig, ax = panel()
        ax.stairs(counts, edges, fill=True, color=colour, alpha=0.55)
        if in_sigma:
            x = np.linspace(-5, 5, 201)
            ax.plot(x, np.exp(-x * x / 2) / np.sqrt(2 * np.pi), color="#222222", lw=1.1, label="noise alone")
            ax.legend(loc="upper right")
        ax.set(xlim=(-limit, limit), ylabel="share of readings per unit", ylim=(0, None))
        ax.set_xlabel("(model − reading) / u(f)" if in_sigma else "(model − reading)/reading, %")
        ax.grid(axis="y")
        return svg(fig, label)
