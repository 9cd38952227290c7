"""Subjects side by side: lobes and albedo of all of them in one colour each, and a sphere of each."""

import base64
from collections.abc import Sequence

import numpy as np

from gonio.figures.albedo import AlbedoCurve, draw_albedo
from gonio.figures.lobes import Curve, draw_in_plane
from gonio.figures.model_values import COMPARED, plane_angles
from gonio.figures.spheres import png, sphere_pixels
from gonio.figures.style import colour_of, picture, size_for
from gonio.reports.check_figures import albedo_of
from gonio.reports.evaluations import Evaluation
from gonio.reports.figure import ReportFigure, rounded
from gonio.reports.subject import ReportSubject

LONGEST = 22


def shortened(name: str) -> str:
    """A name that fits a legend of two columns."""
    return name if len(name) <= LONGEST else name[: LONGEST - 9] + "…" + name[-8:]


def comparison_figures(evaluated: Sequence[tuple[ReportSubject, Evaluation]]) -> list[ReportFigure]:
    """Figures of several subjects at once; none for a single one."""
    if len(evaluated) < 2:
        return []
    lobes = [_lobes(evaluated, k, theta_i) for k, theta_i in enumerate(COMPARED)]
    return [f for f in (*lobes, _albedo([s for s, _ in evaluated])) if f is not None]


def _lobes(evaluated: Sequence[tuple[ReportSubject, Evaluation]], k: int, theta_i: float) -> ReportFigure | None:
    curves, data = [], []
    for s, e in evaluated:
        sources = e.sources(s)
        if sources:
            name, values = sources[-1]
            style = colour_of(s.number)
            f = values.compared[k]
            curves.append(Curve(plane_angles(theta_i), f, shortened(s.name), style.colour, style.dash))
            data.append({"subject": s.name, "channel": s.channel, "of": name, "f_per_sr": rounded(f)})
    if len(curves) < 2:
        return None
    caption = (
        f"In the plane of incidence, θᵢ = {theta_i:g}°, the middle channel of each. Tables: the fitted model "
        "where there is one, else the readings, interpolated."
    )
    label = f"f of all subjects in the plane of incidence, incidence {theta_i:g}°"
    image = picture(label, draw_in_plane, curves, True, size=size_for([c.label for c in curves]))
    angles = np.round(plane_angles(theta_i), 4)
    data = {"theta_i_deg": theta_i, "theta_o_deg": angles, "all": data}
    return ReportFigure(f"lobes-{theta_i:g}", caption, image, data)


def _albedo(subjects: Sequence[ReportSubject]) -> ReportFigure | None:
    curves, data = [], []
    for s in subjects:
        series = albedo_of(s)
        if series is not None:
            k = s.shown if len(series.names) > 1 else 0
            style = colour_of(s.number)
            albedo, bound = series.albedo[k], series.bound[k]
            curves.append(AlbedoCurve(series.theta_i, albedo, bound, shortened(s.name), style.colour, dash=style.dash))
            data.append(
                {"subject": s.name, "channel": series.names[k], "theta_i_deg": rounded(series.theta_i),
                 "albedo": rounded(albedo), "bound": rounded(bound)}
            )  # fmt: skip
    if len(curves) < 2:
        return None
    caption = "Directional albedo, the middle channel of each, with its bound where there is one; the dashed line is 1."
    size = size_for([c.label for c in curves])
    image = picture("Directional albedo of all subjects", draw_albedo, curves, size=size)
    return ReportFigure("albedo", caption, image, {"all": data})


def sphere_of(s: ReportSubject, e: Evaluation) -> str | None:
    """A small sphere under the first light as the data of an image; None where there is none."""
    sources = e.sources(s)
    if not sources:
        return None
    pixels = sphere_pixels(sources[0][1].spheres[0])
    return "data:image/png;base64," + base64.b64encode(png(pixels)).decode()
