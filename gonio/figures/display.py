"""What `plot` draws of each public object, and the small picture that a notebook shows of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gonio.checks.certificate import Certificate
from gonio.data.scene import Scene
from gonio.data.table import Channels
from gonio.figures import diagnostics, plots, style
from gonio.fitting.result import FitResult
from gonio.instrument.instrument import Instrument
from gonio.models.deferred import deferred
from gonio.models.display import Displayed
from gonio.models.errors import GonioError, nearest

if TYPE_CHECKING:
    from matplotlib import patches
    from matplotlib.axes import Axes
else:
    patches = deferred("matplotlib.patches")

NARROWEST = 1.0  # degrees: a wedge that is narrower is not seen
SOURCE_ANGLE, DETECTOR_ANGLE = 45.0, 30.0  # degrees from the normal, where an instrument's arms are drawn


class Beam(NamedTuple):
    """Directions in a section of the hemisphere, degrees from the normal; those to the left are negative."""

    low: float
    high: float
    colour: str
    label: str


def plot(shown: Displayed, kind: str | None = None, *, ax: Axes | None = None, **options: object) -> Axes:
    """The plot of this kind of an object; by default the first kind that it has."""
    kinds = _kinds(shown)
    name = kind or next(iter(kinds))
    if name not in kinds:
        raise GonioError(f"there is no plot {name!r} of a {type(shown).__name__}; {nearest(name, kinds)}")
    return kinds[name](shown, ax=ax, **options)


def thumbnail(shown: Displayed) -> str:
    """A small picture as an SVG element; empty where the object has none."""
    if isinstance(shown, Scene | Instrument):
        return style.picture(type(shown).__name__, _draw_beams, _beams(shown), size=(2.4, 1.5)).svg()
    subject = shown.material if isinstance(shown, FitResult) else shown
    try:
        return "" if isinstance(shown, Certificate) else plots.thumbnail_svg(subject)
    except GonioError:  # a table whose readings do not make a lobe, or an object that is no subject
        return ""


def _kinds(shown: Displayed) -> dict[str, Callable[..., Axes]]:
    if isinstance(shown, Scene | Instrument):
        return {"directions": _plot_beams}
    if isinstance(shown, Certificate):
        return {"albedo": _plot_certificate}
    kinds = {kind: getattr(plots, f"plot_{kind}") for kind in ("lobe", "slice", "sphere", "albedo")}
    return kinds | ({"residuals": plots.plot_residuals} if isinstance(shown, FitResult) else {})


def _plot_certificate(certificate: Certificate, *, ax: Axes | None = None) -> Axes:
    """Directional albedo as the check computed it, with the bound on its error."""
    energy = certificate["energy"]
    count = np.shape(energy.series.get("albedo", [[]]))
    series = diagnostics.albedo_series(energy, Channels.of_count(count[0] if len(count) > 1 else 1))
    if series is None:
        raise GonioError(f"the check of {certificate.subject} computed no albedo: {energy.detail}")
    curves = series.curves(style.PALETTE[0], "o" if certificate.kind == "table" else None)
    return plots.draw_on(ax, certificate.subject, diagnostics.draw_albedo, curves)


def _plot_beams(shown: Scene | Instrument, *, ax: Axes | None = None) -> Axes:
    """Lights and views of a scene, or source and detector of an instrument, in a section of the hemisphere."""
    return plots.draw_on(ax, type(shown).__name__, _draw_beams, _beams(shown))


def _beams(shown: Scene | Instrument) -> list[Beam]:
    light, view = style.PALETTE[4], style.PALETTE[0]
    if isinstance(shown, Instrument):
        source, detector = (math.degrees(a) for a in (shown.source_half_angle, shown.detector_half_angle))
        return [
            Beam(-SOURCE_ANGLE - source, -SOURCE_ANGLE + source, light, "source"),
            Beam(DETECTOR_ANGLE - detector, DETECTOR_ANGLE + detector, view, "detector"),
        ]
    lights = [Beam(-math.degrees(r.theta[1]), -math.degrees(r.theta[0]), light, "lights") for r in shown.lights]
    return lights + [Beam(math.degrees(r.theta[0]), math.degrees(r.theta[1]), view, "views") for r in shown.views]


def _draw_beams(ax: Axes, beams: Sequence[Beam]) -> None:
    behind = any(max(-b.low, b.high) > 90 for b in beams)
    ax.add_patch(
        patches.Wedge((0, 0), 1.0, 0, 360 if behind else 180, facecolor="none", edgecolor=style.AXIS_GREY, lw=0.8)
    )
    labels: set[str] = set()
    for b in beams:
        middle, half = (b.low + b.high) / 2, max(b.high - b.low, NARROWEST) / 2
        label = f"_{b.label}" if b.label in labels else b.label
        labels.add(b.label)
        ax.add_patch(
            patches.Wedge((0, 0), 1.0, 90 - middle - half, 90 - middle + half, color=b.colour, alpha=0.4, label=label)
        )
    if behind:  # the sample, seen from its edge
        ax.plot([-1, 1], [0, 0], color=style.AXIS_GREY, lw=0.8)
    ax.set(xlim=(-1.05, 1.05), ylim=(-1.05 if behind else -0.05, 1.05), aspect="equal")
    ax.set_axis_off()
    style.legend_above(ax)
