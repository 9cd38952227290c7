"""Lobes: f in the plane of incidence against the angle and as a polar diagram, and over the hemisphere in space."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gonio.figures import style
from gonio.figures.maps import MAP
from gonio.figures.style import AXIS_GREY, FAINT, INK, RULE, degree_axis, log_axis, positive_range
from gonio.models.deferred import deferred
from gonio.text import sr_label

if TYPE_CHECKING:
    import matplotlib
    from matplotlib import collections, patches, ticker
    from matplotlib.axes import Axes
else:
    matplotlib = deferred("matplotlib")
    collections = deferred("matplotlib.collections")
    patches = deferred("matplotlib.patches")
    ticker = deferred("matplotlib.ticker")


@dataclasses.dataclass(frozen=True)
class Curve:
    """One line (a model) or one set of points (readings) of a panel: theta_o signed degrees and f, 1/sr, shape (n,)."""

    theta_o: np.ndarray
    f: np.ndarray
    label: str
    colour: str
    dash: style.Dash = "-"
    marker: str | None = None
    """Drawn as points, never joined, where a marker is given."""
    theta_i: float | None = None
    """Degrees; polar diagrams draw the incoming ray."""
    u: np.ndarray | None = None
    """Standard uncertainties, 1/sr, (n,), which are drawn as bars against the angle; NaN where unknown."""


def draw_in_plane(ax: Axes, curves: Sequence[Curve], log: bool) -> None:
    """f against the signed outgoing angle."""
    end = 180 if _behind(curves) else 90
    ax.set_xlim(-end, end)
    degree_axis(ax.xaxis, range(-end, end + 1, end // 3))
    ax.set_xlabel("θₒ  (light’s side  ←   → mirror’s side)" + ", beyond ±90° through it" * (end > 90))
    for horizon in (-90, 90) if end > 90 else ():
        ax.axvline(horizon, color=AXIS_GREY, lw=0.7)
    if log:
        log_axis(ax, *value_range(curves))
    else:
        _linear_axis(ax, curves)
    for c in curves:
        style.draw_bars(ax, c.theta_o, c.f, c.u, c.colour)
        _draw(ax, c.theta_o, np.where(c.f > 0, c.f, np.nan) if log else c.f, c)
    ax.set_ylabel("f / sr⁻¹")
    style.legend_above(ax)


def _linear_axis(ax: Axes, curves: Sequence[Curve]) -> None:
    ends = [c.f + sign * (0.0 if c.u is None else np.nan_to_num(c.u)) for c in curves for sign in (-1, 1)]
    values = np.concatenate([np.zeros(1), *(f[np.isfinite(f)] for f in ends)])
    low, high = values.min(), values.max() if values.size > 1 else 1.0
    span = (high - low) or 1.0
    ax.set_ylim(low - (0.04 * span if low < 0 else 0.0), high + 0.04 * span)
    ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda v, _: sr_label(float(f"{v:.6g}"))))
    ax.grid(axis="y")
    if low < 0:
        ax.axhline(0.0, color=AXIS_GREY, lw=0.7)


def value_range(curves: Sequence[Curve]) -> tuple[float, float]:
    """The smallest and largest positive value to be shown on a logarithmic scale."""
    return positive_range(np.concatenate([np.zeros(0), *(c.f for c in curves)]), 2.0, 1.5)


def _draw(ax: Axes, x: np.ndarray, y: np.ndarray, c: Curve) -> None:
    if c.marker:
        style.draw_dots(ax, x, y, c.colour)
        ax.plot([], [], c.marker, ms=2.9, color=c.colour, mew=0, label=c.label, ls="none")
    else:
        # Nothing leaves along the horizon: the line is broken between the two sides.
        between = np.abs(np.abs(c.theta_o) - 90.0) < 1e-9
        ax.plot(x, np.where(between, np.nan, y), color=c.colour, ls=c.dash, label=c.label)


def draw_polar(ax: Axes, curves: Sequence[Curve], log: bool) -> None:
    """The lobes as they leave the surface: radius is f, or its logarithm above the smallest ring."""
    low, high = value_range(curves)
    rings = _log_rings(low, high) if log else _linear_rings(curves)
    floor, top = math.log10(rings[0]) if log else 0.0, rings[-1]
    span = (math.log10(top) - floor) if log else top
    radii = [(math.log10(r) - floor) / span if log else r / span for r in rings]
    _half_disc(ax, rings, radii)
    if _behind(curves):
        _lower_half(ax, radii)
    for c in curves:
        radius = _radius(c.f, floor, span, log)
        t = np.radians(c.theta_o)
        _draw(ax, radius * np.sin(t), radius * np.cos(t), c)
        if c.theta_i is not None:
            _incoming(ax, c.theta_i, c.colour)
    style.legend_above(ax)


def _behind(curves: Sequence[Curve]) -> bool:
    """Whether some of the angles are behind the sample."""
    return any(np.abs(c.theta_o).max(initial=0.0) > 90 for c in curves)


def _lower_half(ax: Axes, radii: list[float]) -> None:
    """Rings and rays behind the sample."""
    ax.set_ylim(-1.16, 1.16)
    for degrees in (-150, -120, 120, 150, 180):
        t = math.radians(degrees)
        ax.plot([0, math.sin(t)], [0, math.cos(t)], color=RULE, lw=0.6, zorder=0)
        ax.text(
            1.045 * math.sin(t), 1.035 * math.cos(t), f"{degrees}°".replace("-", "−"), color=INK, fontsize=9,
            ha="center" if degrees == 180 else "left" if degrees > 0 else "right", va="top",
        )  # fmt: skip
    for radius in radii:
        ax.add_patch(patches.Wedge((0, 0), radius, 180, 360, fill=False, ec=RULE, lw=0.6, zorder=0))


def _radius(f: np.ndarray, floor: float, span: float, log: bool) -> np.ndarray:
    if not log:
        return np.where(f > 0, f, np.nan if (f < 0).any() else 0.0) / span
    shown = np.isfinite(f) & (f > 0)
    level = (np.log10(np.where(shown, f, 1.0)) - floor) / span
    return np.where(shown & (level >= 0), level, np.nan)


def _linear_rings(curves: Sequence[Curve]) -> list[float]:
    top = max((float(np.nanmax(c.f, initial=0.0)) for c in curves), default=1.0) or 1.0
    exponent = 10.0 ** math.floor(math.log10(top / 2))
    step = next(s * exponent for s in (0.5, 1, 2, 5, 10, 20) if top / (s * exponent) <= 4.0)
    return [step * k for k in range(1, math.ceil(top / step - 1e-9) + 1)]


def _log_rings(low: float, high: float) -> list[float]:
    ticks = style.decades_between(low, high)
    return ticks if len(ticks) > 1 else [low, math.sqrt(low * high), high]


def _half_disc(ax: Axes, rings: list[float], radii: list[float]) -> None:
    ax.set_aspect("equal")
    ax.axis("off")
    ax.set(xlim=(-1.17, 1.17), ylim=(-0.14, 1.16))
    for degrees in range(-90, 91, 30):
        t = math.radians(degrees)
        ax.plot([0, math.sin(t)], [0, math.cos(t)], color=RULE, lw=0.6, zorder=0)
        ax.text(
            1.045 * math.sin(t), 1.035 * math.cos(t), f"{degrees}°".replace("-", "−"), color=INK, fontsize=9,
            ha="center" if degrees == 0 else "left" if degrees > 0 else "right",
            va="bottom" if abs(degrees) < 90 else "center",
        )  # fmt: skip
    for value, radius in zip(rings, radii, strict=True):
        ax.add_patch(patches.Wedge((0, 0), radius, 0, 180, fill=False, ec=RULE, lw=0.6, zorder=0))
        if radius > 0:
            ax.text(radius, -0.025, sr_label(value), color=FAINT, fontsize=8, ha="center", va="top")
    ax.text(
        0,
        -0.025,
        "0" if radii[0] > 0 else sr_label(rings[0]),
        color=FAINT,
        fontsize=8,
        ha="center",
        va="top",
    )
    ax.text(-1.0, -0.025, "f / sr⁻¹", color=INK, fontsize=9, ha="left", va="top")
    ax.plot([-1.02, 1.02], [0, 0], color=AXIS_GREY, lw=1.0, zorder=1)


def _incoming(ax: Axes, theta_i: float, colour: str) -> None:
    t = math.radians(-theta_i)
    tip, tail = (0.86 * math.sin(t), 0.86 * math.cos(t)), (math.sin(t), math.cos(t))
    arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.0, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    ax.annotate("", xy=tip, xytext=tail, arrowprops=arrow)


SPACE_SIZE, SPACE_SIZE_THROUGH = (4.9, 3.2), (4.9, 4.4)
TURN, TILT = 35.0, 22.0
"""Direction of the eye at first: degrees about the normal from the plane of incidence, and above the surface."""

AROUND = (-12.0, -6.0, -3.0, -1.5, -0.5, 0.0, 0.5, 1.5, 3.0, 6.0, 12.0)
SPACE_DECADES = 5.0


def mesh_angles(theta_i: float, through: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """(theta_o, delta_phi), degrees: nodes of the mesh, closer together around the mirror direction of theta_i.

    `through`: those on the other side of the sample too, closer around straight through, with a row on the horizon
    between the sides.
    """
    near = np.array(AROUND)
    # As many nodes whatever the incidence: one compiled program evaluates all.
    theta = np.sort(np.concatenate([np.linspace(0, 89.5, 25), np.clip(theta_i + near, 0.01, 89.4)]))
    phi = np.sort(np.concatenate([np.arange(0, 360, 10.0), 180 + near * 1.3 + 0.01, [360.0]]))
    return (np.concatenate([theta, [90.0], 180.0 - theta[::-1]]) if through else theta), phi


def levels(f: np.ndarray, high: float, log: bool) -> np.ndarray:
    """Radii in [0, 1]: f over its largest value, or its logarithm over `SPACE_DECADES` below that; else 0."""
    shown = np.isfinite(f) & (f > 0)
    share = np.where(shown, f, 0.0).astype(float) / high
    if not log:
        return share
    return np.where(shown, np.clip(1 + np.log10(np.maximum(share, 1e-300)) / SPACE_DECADES, 0, 1), 0.0)


def projected(points: np.ndarray, turn: float, tilt: float) -> np.ndarray:
    """(right, up, towards the eye) of points (..., 3), the eye turned about the normal and tilted, degrees."""
    a, t = math.radians(turn), math.radians(tilt)
    x, y, z = np.moveaxis(points, -1, 0)
    right = x * math.cos(a) + y * math.sin(a)
    away = -x * math.sin(a) + y * math.cos(a)
    return np.stack([right, z * math.cos(t) + away * math.sin(t), z * math.sin(t) - away * math.cos(t)], axis=-1)


def draw_lobe(ax: Axes, theta_i: float, f: np.ndarray, high: float, log: bool) -> None:
    """The lobe at one incidence, degrees, the radius logarithmic or not.

    `f`, 1/sr, (theta_o, delta_phi) at `mesh_angles`, of one side or of both, open where it is NaN; `high` is the value
    of radius 1.
    """
    through = len(f) > len(mesh_angles(theta_i)[0])
    theta, phi = (np.radians(a) for a in mesh_angles(theta_i, through))
    r = levels(f, high, log)
    # The light stands on the left: delta_phi = 0 is −x.
    x, y = (-np.sin(theta)[:, None] * a for a in (np.cos(phi), np.sin(phi)))
    unit = np.stack([x, y, np.cos(theta)[:, None] + 0 * phi], axis=-1)
    p = projected(r[..., None] * unit, TURN, TILT)
    quads = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    level = (r[:-1, :-1] + r[1:, 1:]).ravel() / 2
    known = np.isfinite(f)
    whole = known[:-1, :-1] & known[1:, :-1] & known[1:, 1:] & known[:-1, 1:]
    order = np.argsort(quads[..., 2].mean(axis=1))
    order = order[whole.ravel()[order]]
    ax.set_aspect("equal")
    ax.axis("off")
    ax.set(xlim=(-1.1, 1.1), ylim=(-1.02 if through else -0.46, 1.02))
    ring = np.linspace(0, 2 * np.pi, 121)
    base = projected(np.stack([np.cos(ring), np.sin(ring), 0 * ring], -1), TURN, TILT)
    ax.plot(base[:, 0], base[:, 1], color=AXIS_GREY, lw=0.8)
    axis = projected(np.array([[-1.0, 0, 0], [1.0, 0, 0]]), TURN, TILT)
    ax.plot(axis[:, 0], axis[:, 1], color=AXIS_GREY, lw=0.6, ls=(0, (3, 2)))
    faces = collections.PolyCollection(
        list(quads[order][..., :2]),
        facecolors=matplotlib.colormaps[MAP](level[order]),
        edgecolors="face",
        lw=0.3,
        rasterized=True,
    )
    ax.add_collection(faces)
    t = math.radians(theta_i)
    x, y, _ = projected(np.array([-math.sin(t), 0, math.cos(t)]), TURN, TILT)
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.1, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", xy=(0.72 * x, 0.72 * y), xytext=(x, y), arrowprops=arrow)
    words = f"θᵢ = {theta_i:.4g}°, radius: " + (f"log f, {SPACE_DECADES:.0f} decades" if log else "f")
    ax.text(-1.08, -1.0 if through else -0.44, words, color=FAINT, fontsize=9)
