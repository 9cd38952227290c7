"""Light below a surface: R by the distance, log-log; residuals of fits; edge loss by the size of a lit spot."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gonio.figures import style
from gonio.figures.style import log_axis, positive_range
from gonio.models.deferred import deferred
from gonio.text import without_zeros

if TYPE_CHECKING:
    from matplotlib import ticker
    from matplotlib.axes import Axes
else:
    ticker = deferred("matplotlib.ticker")

ROOM = 1.35
"""Factor of room beside the first and the last distance, and the least and the greatest R."""
READING_DECADES = 20.0
"""Readings are seen down to here: a profile falls far."""
AT_ZERO = 2.2
"""A reading at no distance is drawn so many times nearer than the first other one."""
RESIDUAL_LIMIT = 3.0


@dataclasses.dataclass(frozen=True)
class ProfilePoints:
    """Readings of a channel: distances r (n,), mm, values and standard uncertainties (n,), 1/mm²."""

    r: np.ndarray
    value: np.ndarray
    u: np.ndarray
    label: str
    colour: str


@dataclasses.dataclass(frozen=True)
class Curve:
    """A line through points (n,)."""

    x: np.ndarray
    y: np.ndarray
    label: str
    colour: str
    dash: style.Dash = "-"


def draw_profile(ax: Axes, points: Sequence[ProfilePoints], curves: Sequence[Curve]) -> None:
    """R of each channel with bars of one standard uncertainty, and models through them, on logarithmic axes."""
    values = np.concatenate([*(p.value for p in points), *(c.y for c in curves)])
    low, high = positive_range(values, 2.0, 1.5, READING_DECADES if points else style.DECADES)
    log_axis(ax, low / ROOM, high * ROOM)
    r = np.concatenate([*(p.r for p in points), *(c.x for c in curves)])
    _distances(ax, r, bool((r == 0).any()))
    nearest = float(np.min(r[r > 0], initial=np.inf))
    for p in points:
        x = np.where(p.r > 0, p.r, nearest / AT_ZERO if np.isfinite(nearest) else 1.0)
        style.draw_bars(ax, x, p.value, p.u, p.colour)
        style.draw_dots(ax, x, np.where(p.value > 0, p.value, np.nan), p.colour)
        ax.plot([], [], "o", ms=2.9, color=p.colour, mew=0, label=p.label, ls="none")
    for c in curves:
        ax.plot(c.x, np.where(c.y > 0, c.y, np.nan), color=c.colour, ls=c.dash, lw=1.1, label=c.label)
    ax.set_xlabel("distance of the spots / mm" if points else "distance from a narrow beam / mm")
    ax.set_ylabel("R / mm⁻²")
    style.legend_above(ax)


def draw_profile_residuals(ax: Axes, points: Sequence[ProfilePoints], unit: str) -> None:
    """Residuals of a fit over the distance, `value` in units of `unit`."""
    r, every = (np.concatenate([getattr(p, name) for p in points]) for name in ("r", "value"))
    size = max(RESIDUAL_LIMIT if unit.startswith("u") else 0.0, 1.1 * float(np.nanmax(np.abs(every), initial=0.0)))
    ax.set_ylim(-(size or 1.0), size or 1.0)
    _distances(ax, r, bool((r == 0).any()))
    ax.axhline(0.0, color=style.AXIS_GREY, lw=0.8)
    nearest = float(np.min(r[r > 0], initial=np.inf))
    for p in points:
        x = np.where(p.r > 0, p.r, nearest / AT_ZERO if np.isfinite(nearest) else 1.0)
        style.draw_dots(ax, x, p.value, p.colour)
        ax.plot([], [], "o", ms=2.9, color=p.colour, mew=0, label=p.label, ls="none")
    ax.grid(axis="y")
    ax.set_xlabel("distance of the spots / mm")
    ax.set_ylabel(f"(model − reading) / {unit}")
    style.legend_above(ax)


def draw_edge_loss(ax: Axes, curves: Sequence[Curve], spot: float | None) -> None:
    """Share of the light that a BRDF loses, over the radius of the lit spot; a line at the `spot` that was there."""
    x = np.concatenate([c.x for c in curves])
    ax.set_ylim(0, 1)
    _distances(ax, x, False)
    for c in curves:
        ax.plot(c.x, c.y, color=c.colour, ls=c.dash, label=c.label)
    if spot:
        ax.axvline(spot, color=style.AXIS_GREY, lw=0.8, ls=(0, (4, 2)))
    ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda v, _: f"{100 * v:.0f} %"))
    ax.grid(axis="y")
    ax.set_xlabel("radius of the lit spot / mm")
    ax.set_ylabel("edge loss")
    style.legend_above(ax)


def _distances(ax: Axes, r: np.ndarray, zero: bool) -> None:
    """A logarithmic axis of distances, with a place for none."""
    positive = r[r > 0]
    low, high = (float(positive.min()), float(positive.max())) if positive.size else (1.0, 1.0)
    ax.set_xlim(low / (AT_ZERO * ROOM if zero else ROOM), high * ROOM)
    ax.set_xscale("log")
    ax.set_xlim(low / (AT_ZERO * ROOM if zero else ROOM), high * ROOM)
    ticks = style.mantissa_ticks(low / ROOM, high * ROOM, (1,) if high > 30 * low else (1, 2, 5))
    at_zero = [low / AT_ZERO] if zero else []
    ax.set_xticks([*at_zero, *ticks], ["0", *map(_mm, ticks)] if zero else list(map(_mm, ticks)))
    ax.xaxis.set_minor_formatter(ticker.NullFormatter())
    if zero:
        ax.axvline(low / AT_ZERO**0.5, color=style.RULE, lw=0.8)


def _mm(value: float) -> str:
    return without_zeros(f"{value:.6f}") if value >= 1e-3 else f"{value:.0e}"
