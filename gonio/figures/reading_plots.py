"""Readings as readings: f with its uncertainty over the angle that varies, and over the wavelength."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gonio.figures import style
from gonio.figures.style import degree_axis, log_axis, positive_range
from gonio.text import sr_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_GROUPS = 7
SAME = 0.05
"""Degrees: angles that are nearer are the same setting."""
LOGARITHMIC = 30.0
"""Largest over smallest value from which on the axis is logarithmic."""
SYMBOLS = {"theta_i": "θᵢ", "phi_i": "φᵢ", "theta_o": "θₒ", "delta_phi": "Δφ"}
LABELS = {
    "theta_i": "θᵢ (incidence)", "phi_i": "φᵢ (azimuth of the light)", "theta_o": "θₒ (outgoing)",
    "delta_phi": "Δφ (detector’s azimuth minus the light’s)",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Points:
    """A set of readings: x (n,), f and its standard uncertainty u (n,), 1/sr, NaN where unknown."""

    x: np.ndarray
    f: np.ndarray
    u: np.ndarray
    label: str
    colour: str
    joined: bool = False
    """Whether a faint line leads the eye from point to point."""


def settings(angle: np.ndarray) -> np.ndarray:
    """Different values of an angle, degrees, those within `SAME` as one."""
    return np.unique(np.round(angle / SAME).astype(int))


def varying_angle(angles: dict[str, np.ndarray]) -> tuple[str, dict[str, np.ndarray]]:
    """The angle with the most settings, and masks (n,) of the readings that share all other angles, by their names.

    Args:
        angles: degrees (n,), by `SYMBOLS`.

    Returns:
        The angle's name, and at most `MOST_GROUPS` groups; all readings in one where there would be more.
    """
    varying = max(angles, key=lambda name: settings(angles[name]).size)
    others = [name for name in angles if name != varying]
    keys = np.stack([np.round(angles[name] / SAME).astype(int) for name in others], axis=1)
    unique, group = np.unique(keys, axis=0, return_inverse=True)
    if len(unique) > MOST_GROUPS:
        return varying, {"readings": np.full(len(keys), True)}
    shown = [k for k, name in enumerate(others) if len(np.unique(unique[:, k])) > 1] or range(len(others))
    labels = [", ".join(f"{SYMBOLS[others[k]]} {row[k] * SAME:.4g}°" for k in shown) for row in unique]
    return varying, {label: group.ravel() == k for k, label in enumerate(labels)}


def draw_over_angle(ax: Axes, points: Sequence[Points], angle: str) -> None:
    """f of each set over an angle in degrees, with bars of one standard uncertainty."""
    x = np.concatenate([p.x for p in points])
    _draw(ax, points)
    if x.size and np.ptp(x) > 30:
        top = 45 * np.ceil(x.max() / 45) if x.max() > 90 else 15 * np.ceil(x.max() / 15)
        degree_axis(ax.xaxis, np.arange(0, top + 1, 45 if x.max() > 90 else 15))
    ax.set_xlabel(LABELS[angle])


def draw_over_wavelength(ax: Axes, points: Sequence[Points]) -> None:
    """f of each set over the wavelength in nm, with bars of one standard uncertainty."""
    _draw(ax, points)
    ax.set_xlabel("wavelength / nm")


def _draw(ax: Axes, points: Sequence[Points]) -> None:
    f = np.concatenate([p.f for p in points])
    positive = f[np.isfinite(f) & (f > 0)]
    x = np.concatenate([p.x for p in points])
    margin = 0.04 * (np.ptp(x) or 1.0)
    ax.set_xlim(x.min() - margin, x.max() + margin)
    if positive.size == np.isfinite(f).sum() and positive.size and positive.max() > LOGARITHMIC * positive.min():
        log_axis(ax, *positive_range(positive, 2.0, 1.5))
    else:
        ends = np.concatenate([np.zeros(1), *(p.f + s * np.nan_to_num(p.u) for p in points for s in (-1, 1))])
        low, high = np.nanmin(ends), np.nanmax(ends)
        ax.set_ylim(low - 0.04 * (high - low) * (low < 0), high + 0.04 * ((high - low) or 1.0))
        ax.yaxis.set_major_formatter(lambda v, _: sr_label(float(f"{v:.6g}")))
        ax.grid(axis="y")
    for p in points:
        order = np.argsort(p.x, kind="stable")
        if p.joined:
            ax.plot(p.x[order], p.f[order], color=p.colour, lw=0.7, alpha=0.6)
        style.draw_bars(ax, p.x, p.f, p.u, p.colour)
        style.draw_dots(ax, p.x, p.f, p.colour)
        ax.plot([], [], "o", ms=2.9, color=p.colour, mew=0, label=p.label, ls="none")
    ax.set_ylabel("f / sr⁻¹")
    style.legend_above(ax)
