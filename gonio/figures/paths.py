"""The path of a measurement: where light and detector go, in which order, and how long is counted there."""

import os
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gonio.data.files import new_file, refuse_existing
from gonio.figures.legible import make_legible
from gonio.figures.plots import PICTURES
from gonio.figures.style import FAINT, HEIGHT, PALETTE, WIDTH, styled
from gonio.models.errors import GonioError

LARGEST_DOT, SMALLEST_DOT = 260.0, 5.0
"""Square points: areas go with counting time."""


def write_path(
    angles: np.ndarray, seconds: np.ndarray, title: str, output: str | os.PathLike[str], force: bool
) -> None:
    """Writes the picture of a path as PNG, SVG or PDF.

    Args:
        angles: theta_i, phi_i, theta_o, phi_o in their order, radians, shape (4, n).
        seconds: counting times (n,).
        title: stands above.
        output: the file.
        force: replaces an existing file.

    Raises:
        GonioError: for another ending, or an existing file.
    """
    require_picture(output, force)
    with styled(), new_file(output, force) as temporary:
        fig = Figure(figsize=(2 * WIDTH, HEIGHT + 0.9), layout="constrained")
        panels = fig.subplots(1, 2, subplot_kw={"projection": "polar"})
        for ax, k, name in zip(panels, (0, 2), ("light", "detector"), strict=True):
            draw_path(ax, angles[k], angles[k + 1], seconds, name)
        fig.suptitle(title, fontsize=10)
        make_legible(fig).savefig(temporary, format=Path(output).suffix.lower()[1:])


def require_picture(output: str | os.PathLike[str], force: bool) -> None:
    """Raises GonioError where a picture cannot be written there."""
    if Path(output).suffix.lower() not in PICTURES:
        raise GonioError(f"{output} is no picture that can be written; end its name in {', '.join(PICTURES)}")
    refuse_existing(output, force)


def draw_path(ax: Axes, theta: np.ndarray, phi: np.ndarray, seconds: np.ndarray, name: str) -> None:
    """One side's directions on polar axes: the radius is the polar angle, the area of a dot the counting time there.

    Rings stand at 30° and 60°.
    """
    radius = np.degrees(theta)
    ax.plot(phi, radius, color=FAINT, lw=0.5, alpha=0.7)
    places, place = np.unique(np.stack([phi, radius]), axis=1, return_inverse=True)
    total = np.bincount(place.ravel(), seconds)
    area = np.maximum(LARGEST_DOT * total / total.max(), SMALLEST_DOT)
    ax.scatter(*places, s=area, color=PALETTE[0], alpha=0.6, lw=0)
    for place, text, colour in ((0, "first", PALETTE[1]), (-1, "last", PALETTE[2])):
        ax.scatter(phi[place], radius[place], s=30, facecolor="none", edgecolor=colour, label=text, zorder=3)
    ax.set_ylim(0, 90)
    ax.set_yticks([30, 60, 90], [])
    ax.set_title(name, fontsize=10)
    ax.legend(loc="lower left", bbox_to_anchor=(-0.12, -0.08))
