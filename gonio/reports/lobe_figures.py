"""Figures of where a subject sends its light: lobes in the plane and in space, maps, a slice, lit spheres."""

from typing import Any

import numpy as np

from gonio.data.table import Table
from gonio.figures.lobes import SPACE_SIZE, Curve, draw_in_plane, draw_lobe, draw_polar, mesh_angles
from gonio.figures.maps import (
    DIFFERENCE,
    HALF,
    MAP_SIZE,
    SCALE_SIZE,
    SHOWN,
    SIDE,
    colour_range,
    draw_dots,
    draw_map,
    draw_scale,
    draw_slice,
    slice_range,
)
from gonio.figures.spheres import LIGHTS, draw_spheres, sphere_pixels, spheres_size
from gonio.figures.style import colour_of, picture, shades, size_for
from gonio.figures.values import NEAR_INCIDENCE, OFF_PLANE, ModelValues, in_plane_readings, plane_angles
from gonio.fitting.residuals.colour_difference import colour_matrix
from gonio.reports.subject import Evaluation, ReportFigure, ReportSubject, rounded

MOST_DOTS = 4000
PEAKED = 20.0
"""A lobe whose peak is this many times its median is shown in logarithms."""


def plane_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """f in the plane of incidence: polar and against the angle, linear and logarithmic."""
    warped = e.model is None and s.table is not None and s.table.interpolant is not None
    lines = e.interpolated if warped else e.model
    curves, data = _plane_curves(s, e, lines)
    if not curves:
        return []
    caption = f"In the plane of incidence, channel {s.channel}. "
    if s.table is not None and lines is not None:
        caption += f"Lines: {'the readings, ' + e.interpolation if warped else 'the fitted model'}. "
    if e.near:
        caption += f"Points: readings{_near_words(s.table)}. "
    where = f"of {s.name}, channel {s.channel}, in the plane of incidence"
    size = size_for([c.label for c in curves])
    figures = []
    for log, scale in ((False, "linear"), (True, "logarithmic")):
        polar = picture(f"Polar diagram {where}, {scale}", draw_polar, curves, log)
        plane = picture(f"f {where}, {scale}", draw_in_plane, curves, log, size=size)
        end = "log" if log else "linear"
        figures.append(ReportFigure(f"polar-{end}", f"{caption}Polar, {scale}.", polar, data))
        figures.append(ReportFigure(f"plane-{end}", f"{caption}{scale.capitalize()}.", plane, data))
    return sorted(figures, key=lambda f: f.slug.startswith("plane"))


def _plane_curves(s: ReportSubject, e: Evaluation, lines: ModelValues | None) -> tuple[list[Curve], dict[str, Any]]:
    """(curves, their numbers): lines of a model and points of readings for each incidence."""
    tones = shades(colour_of(s.number).colour, len(e.incidences))
    curves, data = [], {"channel": s.channel, "lines": [], "readings": []}
    for k, (theta_i, tone) in enumerate(zip(e.incidences, tones, strict=True)):
        label = f"θᵢ {theta_i:.4g}°"
        if lines is not None:
            curve = Curve(plane_angles(theta_i), lines.curves[k], label, tone, theta_i=theta_i)
            curves.append(curve)
            data["lines"].append(_curve_numbers(theta_i, curve))
        if e.near:
            x, f = in_plane_readings(e.near[theta_i])
            name, incoming = (label, theta_i) if lines is None else ("_nolegend_", None)
            points = Curve(x, f[:, s.shown], name, tone, marker="o", theta_i=incoming)
            data["readings"].append(_curve_numbers(theta_i, points))
            if np.isfinite(points.f).any():
                curves.append(points)
    return curves, data


def _curve_numbers(theta_i: float, curve: Curve) -> dict[str, Any]:
    return {"theta_i_deg": theta_i, "theta_o_deg": np.round(curve.theta_o, 4), "f_per_sr": rounded(curve.f)}


def _near_words(table: Table | None) -> str:
    if table is not None and table.layout.in_half_vectors:
        return f" within {NEAR_INCIDENCE:g}° of the incidence and {OFF_PLANE:g}° of the plane"
    return "" if table is None or table.layout.gridded else f" within {OFF_PLANE:g}° of the plane"


def map_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """f over the outgoing hemisphere: readings as dots, the model as a map, on one colour scale."""
    near = [(t, e.near[t].of_channel(s.shown, MOST_DOTS)) for t in e.map_incidences if e.near]
    dots = [(t, readings) for t, readings in near if readings.f.size]
    maps = [] if e.model is None else list(zip(e.map_incidences, e.model.maps, strict=False))
    if not dots and not maps:
        return []
    scale = colour_range(np.concatenate([*(readings.f for _, readings in dots), *(f for _, f in maps)]))
    figures = []
    where = f"of {s.name} over the outgoing hemisphere, incidence"
    for theta_i, readings in dots:
        image = picture(f"Readings {where} {theta_i:.4g}°", draw_dots, *readings, scale, theta_i, size=MAP_SIZE)
        numbers = zip(("theta_o_deg", "delta_phi_deg", "f_per_sr"), map(rounded, readings), strict=True)
        data = {"theta_i_deg": theta_i, **dict(numbers)}
        figures.append(ReportFigure(f"readings-{theta_i:.4g}", "Readings.", image, data, "small"))
    for theta_i, f in maps:
        image = picture(f"f {where} {theta_i:.4g}°", draw_map, f, scale, theta_i, size=MAP_SIZE)
        words = "Fitted model." if s.table is not None else "Model."
        data = {"theta_i_deg": theta_i, "pixels_across": SIDE, "f_per_sr": rounded(f, 4)}
        figures.append(ReportFigure(f"map-{theta_i:.4g}", words, image, data, "small"))
    caption = (
        f"f over the outgoing hemisphere from above (equal areas are equal solid angles), channel {s.channel}; "
        "○ light, + mirror direction, grey: no positive value."
    )
    bar = picture("Colour scale of f in 1/sr", draw_scale, scale, size=SCALE_SIZE)
    data = {"low_per_sr": scale[0], "high_per_sr": scale[1]}
    return [*figures, ReportFigure("map-scale", caption, bar, data, "bar")]


def space_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """The lobe in space, to be turned by hand; the picture is for paper."""
    sources = e.sources(s)
    high = max((_highest(f) for _, values in sources for f in values.meshes), default=0.0)
    if not high > 0:
        return []
    k = len(e.incidences) // 2
    name, first = sources[0]
    theta, phi = mesh_angles(e.incidences[k])
    mesh = first.meshes[k].reshape(theta.size, phi.size)
    positive = mesh[np.isfinite(mesh) & (mesh > 0)]
    log = bool(positive.size and positive.max() > PEAKED * np.median(positive))
    data = {
        "channel": s.channel,
        "highest_per_sr": high,
        "logarithmic": log,
        "sources": [
            {"name": label, "incidences": [_mesh_numbers(*m) for m in zip(e.incidences, values.meshes, strict=False)]}
            for label, values in sources
        ],
    }
    label = f"Lobe of {s.name} in space, incidence {e.incidences[k]:.4g}°, {name}"
    top = float(positive.max()) if positive.size else high
    image = picture(label, draw_lobe, e.incidences[k], mesh, top, log, size=SPACE_SIZE)
    caption = f"The lobe in space, channel {s.channel}; {e.interpolation}." if s.table else "The lobe in space."
    return [ReportFigure("lobe", caption, image, data, "space")]


def _highest(f: np.ndarray) -> float:
    return float(f.max(initial=0.0, where=np.isfinite(f)))


def _mesh_numbers(theta_i: float, f: np.ndarray) -> dict[str, Any]:
    theta, phi = mesh_angles(theta_i)
    return {
        "theta_i_deg": theta_i,
        "theta_o_deg": rounded(theta, 5),
        "delta_phi_deg": rounded(phi, 5),
        "f_per_sr": rounded(f.reshape(theta.size, phi.size), 4),
    }


def slice_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """f over half and difference angle at φd = 90°: of readings and of the model, on one colour scale."""
    slices = [(name, values.slice) for name, values in e.sources(s)]
    if not any((f > 0).any() for _, f in slices):
        return []
    scale = slice_range([f for _, f in slices])
    figures = []
    for name, f in slices:
        label = f"f of {s.name} over half and difference angle at a difference azimuth of 90°, {name}"
        data = {
            "phi_d_deg": 90.0, "channel": s.channel, "theta_h_deg": rounded(HALF, 5),
            "theta_d_deg": rounded(DIFFERENCE, 5), "f_per_sr": rounded(f.reshape(len(HALF), -1), 4),
        }  # fmt: skip
        caption = f"f over half and difference angle at φd = 90°, channel {s.channel}: {name}."
        caption += f" Colours by what is within {SHOWN:g}°."
        image = picture(label, draw_slice, f, scale)
        figures.append(ReportFigure(f"slice-{name.split()[0].strip(',')}", caption, image, data))
    return figures


def sphere_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """Lit spheres of readings and of the model."""
    sources = e.sources(s)
    if not sources:
        return []
    colour = "in colour" if colour_matrix(s.channels) is not None else f"channel {s.channel} as grey"
    caption = (
        f"Lit spheres, {colour}; white is a perfect diffuser that faces the light, and what is brighter is cut off."
    )
    several = len(sources) > 1
    rows = [(name if several else "", [sphere_pixels(p) for p in values.spheres]) for name, values in sources]
    data = {"lights_deg": [{"from_the_eye": p, "raised": h} for p, h in LIGHTS], "rows": [name for name, _ in sources]}
    image = picture(f"Lit spheres of {s.name}", draw_spheres, rows, size=spheres_size(len(rows)))
    return [ReportFigure("spheres", caption, image, data)]
