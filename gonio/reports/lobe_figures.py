"""Figures of where a subject sends its light: lobes in the plane and in space, maps, a slice, lit spheres."""

from typing import Any

import numpy as np

from gonio.figures.half_difference_slice import DIFFERENCE, HALF, slice_figure
from gonio.figures.hemisphere import colour_bar, colour_range, hemisphere_dots, hemisphere_map
from gonio.figures.lobe3d import lobe_figure, mesh_angles
from gonio.figures.lobes import Curve, in_plane, polar
from gonio.figures.spheres import LIGHTS, sphere_pixels, spheres_figure
from gonio.figures.style import colour_of, shades
from gonio.fitting.residuals.colour_difference import colour_matrix
from gonio.reports import views
from gonio.reports.evaluations import Seen
from gonio.reports.figure import Drawn, short
from gonio.reports.subject import Subject

DECADES = 6.0
MOST_DOTS = 4000
SHOWN = 80.0  # degrees
PEAKED = 20.0
"""A lobe whose peak is this many times its median is shown in logarithms."""


def plane_figures(s: Subject, seen: Seen) -> list[Drawn]:
    """f in the plane of incidence: polar and against the angle, linear and logarithmic."""
    tones = shades(colour_of(s.number)[0], len(seen.incidences))
    curves, data = [], {"channel": s.channel, "lines": [], "readings": []}
    warped = seen.model is None and s.table is not None and s.table.interpolant is not None
    lines = seen.between if warped else seen.model
    for k, theta_i in enumerate(seen.incidences):
        label = f"θᵢ {theta_i:.4g}°"
        if lines is not None:
            angles, f = views.plane_angles(theta_i), lines.curves[k]
            curves.append(Curve(angles, f, label, tones[k], theta_i=theta_i))
            data["lines"].append({"theta_i_deg": theta_i, "theta_o_deg": np.round(angles, 4), "f_per_sr": short(f)})
        if seen.near:
            x, f = views.in_plane_points(seen.near[theta_i])
            f = f[:, s.shown]
            data["readings"].append({"theta_i_deg": theta_i, "theta_o_deg": np.round(x, 4), "f_per_sr": short(f)})
            if np.isfinite(f).any():
                alone = lines is None
                name = label if alone else "_nolegend_"
                curves.append(Curve(x, f, name, tones[k], marker="o", theta_i=theta_i if alone else None))
    if not curves:
        return []
    what = f"of {s.name}, channel {s.channel}, in the plane of incidence"
    if s.table is not None and lines is not None:
        words = f"Lines: {'the readings, ' + seen.how if warped else 'the fitted model'}. "
    else:
        words = ""
    points = f"Points: readings{_how_near(s)}. " if seen.near else ""
    caption = f"In the plane of incidence, channel {s.channel}. {words}{points}"
    return [
        Drawn("polar-linear", caption + "Polar, linear.", polar(curves, f"Polar diagram {what}, linear", False), data),
        Drawn(
            "polar-log",
            caption + "Polar, logarithmic.",
            polar(curves, f"Polar diagram {what}, logarithmic", True),
            data,
        ),
        Drawn("plane-linear", caption + "Linear.", in_plane(curves, f"f {what}, linear", False), data),
        Drawn("plane-log", caption + "Logarithmic.", in_plane(curves, f"f {what}, logarithmic", True), data),
    ]


def _how_near(s: Subject) -> str:
    if s.table.layout.name == "half_difference":
        return f" within {views.NEAR_INCIDENCE:g}° of the incidence and {views.OFF_PLANE:g}° of the plane"
    if s.table.layout.name == "scattered":
        return f" within {views.OFF_PLANE:g}° of the plane"
    return ""


def map_figures(s: Subject, seen: Seen) -> list[Drawn]:
    """f over the outgoing hemisphere: readings as dots, the model as a map, on one colour scale."""
    dots = []
    for theta_i in seen.maps_at if seen.near else []:
        near = seen.near[theta_i]
        f = near["f"][:, s.shown]
        kept = np.flatnonzero(np.isfinite(f))
        kept = kept[np.linspace(0, kept.size - 1, min(kept.size, MOST_DOTS)).astype(int)] if kept.size else kept
        if kept.size:
            dots.append((theta_i, near["theta_o"][kept], near["delta_phi"][kept], f[kept]))
    maps = [] if seen.model is None else seen.model.maps[: len(seen.maps_at)]
    if not dots and not maps:
        return []
    scale = colour_range(np.concatenate([*(d[3] for d in dots), *maps]))
    drawn = []
    for theta_i, theta_o, phi, f in dots:
        label = f"Readings of {s.name} over the outgoing hemisphere, incidence {theta_i:.4g}°"
        picture = hemisphere_dots(np.radians(theta_o), np.radians(phi), f, scale, theta_i, label)
        data = {
            "theta_i_deg": theta_i,
            "theta_o_deg": short(theta_o),
            "delta_phi_deg": short(phi),
            "f_per_sr": short(f),
        }
        drawn.append(Drawn(f"readings-{theta_i:.4g}", "Readings.", picture, data, "small"))
    for theta_i, f in zip(seen.maps_at, maps, strict=False):
        label = f"f of {s.name} over the outgoing hemisphere, incidence {theta_i:.4g}°"
        words = "Fitted model." if s.table is not None else "Model."
        data = {"theta_i_deg": theta_i, "pixels_across": 121, "f_per_sr": short(f, 4)}
        drawn.append(Drawn(f"map-{theta_i:.4g}", words, hemisphere_map(f, scale, theta_i, label), data, "small"))
    caption = (
        f"f over the outgoing hemisphere from above (equal areas are equal solid angles), channel {s.channel}; "
        "○ light, + mirror direction, grey: no positive value."
    )
    bar = colour_bar(scale, "Colour scale of f in 1/sr")
    drawn.append(Drawn("map-scale", caption, bar, {"low_per_sr": scale[0], "high_per_sr": scale[1]}, "bar"))
    return drawn


def space_figures(s: Subject, seen: Seen) -> list[Drawn]:
    """The lobe in space, to be turned by hand; the picture is for paper."""
    sources = seen.sources(s)
    if not sources:
        return []
    k = len(seen.incidences) // 2
    name, source = sources[0]
    theta, phi = mesh_angles(seen.incidences[k])
    first = source.meshes[k].reshape(theta.size, phi.size)
    positive = [f[np.isfinite(f) & (f > 0)] for _, v in sources for f in v.meshes]
    high = max((float(f.max()) for f in positive if f.size), default=0.0)
    if not high > 0:
        return []
    own = first[np.isfinite(first) & (first > 0)]
    log = bool(own.size and own.max() > PEAKED * np.median(own))
    data: dict[str, Any] = {"channel": s.channel, "highest_per_sr": high, "logarithmic": log, "sources": []}
    for label, view in sources:
        sets = []
        for theta_i, f in zip(seen.incidences, view.meshes, strict=False):
            t, p = mesh_angles(theta_i)
            values = short(f.reshape(t.size, p.size), 4)
            sets.append(
                {"theta_i_deg": theta_i, "theta_o_deg": short(t, 5), "delta_phi_deg": short(p, 5), "f_per_sr": values}
            )
        data["sources"].append({"name": label, "incidences": sets})
    picture = lobe_figure(
        seen.incidences[k], first, float(own.max()) if own.size else high, log,
        f"Lobe of {s.name} in space, incidence {seen.incidences[k]:.4g}°, {name}",
    )  # fmt: skip
    caption = f"The lobe in space, channel {s.channel}; {seen.how}." if s.table is not None else "The lobe in space."
    return [Drawn("lobe", caption, picture, data, "space")]


def slice_figures(s: Subject, seen: Seen) -> list[Drawn]:
    """f over half and difference angle at φd = 90°: of readings and of the model, on one colour scale."""
    sources = [(name, view.slice) for name, view in seen.sources(s)]
    if not sources or not any((f > 0).any() for _, f in sources):
        return []
    # Not towards grazing, where all surfaces are mirrors.
    inner = ((HALF <= SHOWN)[:, None] & (DIFFERENCE <= SHOWN)).ravel()
    scale = colour_range(np.concatenate([f[inner] for _, f in sources]), DECADES)
    drawn = []
    for name, f in sources:
        label = f"f of {s.name} over half and difference angle at a difference azimuth of 90°, {name}"
        data = {
            "phi_d_deg": 90.0, "channel": s.channel, "theta_h_deg": short(HALF, 5),
            "theta_d_deg": short(DIFFERENCE, 5), "f_per_sr": short(f.reshape(len(HALF), -1), 4),
        }  # fmt: skip
        words = f"f over half and difference angle at φd = 90°, channel {s.channel}: {name}."
        words += f" Colours by what is within {SHOWN:g}°."
        drawn.append(Drawn(f"slice-{name.split()[0].strip(',')}", words, slice_figure(f, scale, label), data))
    return drawn


def sphere_figures(s: Subject, seen: Seen) -> list[Drawn]:
    """Lit spheres of readings and of the model."""
    rows = [(name, [sphere_pixels(p) for p in view.spheres]) for name, view in seen.sources(s)]
    if not rows:
        return []
    colour = "in colour" if colour_matrix(s.channels) is not None else f"channel {s.channel} as grey"
    caption = (
        f"Lit spheres, {colour}; white is a perfect diffuser that faces the light, and what is brighter is cut off."
    )
    names = [(name if len(rows) > 1 else "", spheres) for name, spheres in rows]
    data = {"lights_deg": [{"from_the_eye": p, "raised": h} for p, h in LIGHTS], "rows": [n for n, _ in rows]}
    return [Drawn("spheres", caption, spheres_figure(names, f"Lit spheres of {s.name}"), data)]
