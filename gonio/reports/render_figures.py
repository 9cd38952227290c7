"""Figures that Mitsuba renders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gonio.data.material import Material
from gonio.figures.spheres import encoded
from gonio.figures.style import picture
from gonio.reports.evaluation import ReportFigure
from gonio.reports.subject import ReportSubject

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH = 2.6  # inches


def figures(s: ReportSubject) -> list[ReportFigure]:
    """A sphere of each fit, or of the material itself; of a table without a fit of what lies between its readings."""
    materials = [(s.fit_name(k), fit) for k, fit in enumerate(s.fits)] or [("", _of_subject(s))]
    return [_figure(s, k, name, material) for k, (name, material) in enumerate(materials, 1)]


def _of_subject(s: ReportSubject) -> Material:
    from gonio.data.subject import load_material

    return load_material(s.material if s.table is None else s.table)


def _figure(s: ReportSubject, number: int, name: str, material: Material) -> ReportFigure:
    from gonio.exports.preview import rendered  # Mitsuba and its models are loaded with it

    linear, error = rendered(material)
    what = f", {name}" if name else ""
    caption = (
        f"Rendered by Mitsuba 3{what}, as {error.form}: {error.figures}. A sun from the upper left, a dim sky; a white "
        "diffuser that faces the sun is white."
    )
    image = picture(f"Rendered sphere of {s.name}{what}", _draw, encoded(linear), size=(WIDTH, WIDTH))
    data = {
        "form": error.form, "relative_rms": error.relative_rms, "albedo_difference": error.albedo_difference,
        "delta_e_mean": error.delta_e_mean, "delta_e_max": error.delta_e_max, "exact": error.exact,
    }  # fmt: skip
    return ReportFigure(f"rendered-{number}", caption, image, data)


def _draw(ax: Axes, rgb: np.ndarray) -> None:
    ax.imshow(rgb, interpolation="none")
    ax.axis("off")
