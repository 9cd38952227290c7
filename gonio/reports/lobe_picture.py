"""A small picture of a model's lobe, as a file: polar diagrams in the plane of incidence, linear and logarithmic."""

import os
from pathlib import Path

from matplotlib.figure import Figure

from gonio.data.files import new_file, refuse_existing
from gonio.figures.lobes import Curve, draw_polar
from gonio.figures.model_values import INCIDENCES, plane_angles, plane_values
from gonio.figures.style import HEIGHT, WIDTH, colour_of, shades, styled
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError

KINDS = (".png", ".svg", ".pdf")


def lobe_picture(brdf: AbstractBRDF, title: str, output: str | os.PathLike[str], force: bool = False) -> Path:
    """Writes the picture; its kind by the ending. Raises GonioError for another ending, or an existing file."""
    path = Path(output)
    if path.suffix.lower() not in KINDS:
        raise GonioError(f"{path} is no picture that can be written; end its name in {', '.join(KINDS)}")
    refuse_existing(path, force)
    tones = shades(colour_of(0).colour, len(INCIDENCES))
    # The grey of the channels: their mean, as one line an incidence is what a small picture holds.
    curves = [
        Curve(plane_angles(t), f.mean(axis=1), f"θᵢ {t:g}°", tone, theta_i=t)
        for t, f, tone in zip(INCIDENCES, plane_values(brdf, INCIDENCES), tones, strict=True)
    ]
    with styled():
        fig = Figure(figsize=(2 * WIDTH, HEIGHT + 0.3), layout="constrained")
        for ax, log, name in zip(fig.subplots(1, 2), (False, True), ("linear", "logarithmic"), strict=True):
            draw_polar(ax, curves, log)
            ax.text(1.0, -0.06, name, transform=ax.transAxes, va="top", ha="right", fontsize=9)
        fig.suptitle(title, fontsize=10)
        with new_file(path, force) as temporary:
            fig.savefig(temporary, format=path.suffix.lower()[1:])
    return path
