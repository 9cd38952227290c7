"""Figures of where a subject sends its light: lobes in the plane and in space, maps, a slice, lit spheres."""

import dataclasses
from typing import Any

import numpy as np

from gonio.figures import disc, lobes, maps, readings, sampling, spheres
from gonio.figures.sampling import LEAST_KNOWN, ModelValues, known_share
from gonio.figures.spectral_colour import channel_colour
from gonio.figures.style import picture, shades, size_for
from gonio.reports.evaluation import INTERPOLATED, Evaluation, ReportFigure, rounded
from gonio.reports.subject import ReportSubject

MOST_DOTS = 4000
LEAST_OF_SLICE = 0.25
"""Share of a slice that the readings cover, below which it is not drawn: the grazing half of it is rarely read."""
BLANK = " Blank: not read."
THROUGH = ", through the sample"
BARS = ", with their standard uncertainties"
PEAKED = 20.0
"""A lobe whose peak is this many times its median is shown in logarithms."""


def figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """All figures of a subject's lobes, as far as it has values for them; of light from behind after the others."""
    makers = (_plane_figures, _space_figures, _map_figures, _sphere_figures, _disc_figures, _slice_figures)
    made = [figure for make in makers for figure in make(s, e)]
    if e.behind is None:
        return made
    turned = (_plane_figures, _space_figures, _map_figures, _sphere_figures, _slice_figures)
    return made + [_of_light_behind(figure) for make in turned for figure in make(s, e.behind)]


def _of_light_behind(figure: ReportFigure) -> ReportFigure:
    data = figure.data | {"light": "behind"}
    return dataclasses.replace(figure, slug=f"{figure.slug}-lit-behind", data=data)


def _plane_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """f in the plane of incidence: polar and against the angle, linear and logarithmic; the latter for each fit."""
    warped = not e.models and s.table is not None and s.table.interpolant is not None
    lines = [(INTERPOLATED, e.interpolated)] if warped else e.models
    made = _four_planes(s, e, *(lines[0] if lines else ("", None)))
    for k, (name, values) in enumerate(lines[1:], 2):
        curves, data = _plane_curves(s, e, values)
        caption = _plane_caption(s, e, name, values)
        image = picture(f"f of {s.name} in the plane of incidence, {name}{e.lit}", lobes.draw_in_plane, curves, True,
                        size=size_for([c.label for c in curves]))  # fmt: skip
        made.append(ReportFigure(f"plane-log-{k}", f"{caption}Logarithmic.", image, data))
    return made


def _four_planes(s: ReportSubject, e: Evaluation, name: str, lines: ModelValues | None) -> list[ReportFigure]:
    curves, data = _plane_curves(s, e, lines)
    if not curves:
        return []
    caption = _plane_caption(s, e, name, lines)
    where = f"of {s.name}, {s.in_channel}{e.lit}, in the plane of incidence"
    size = size_for([c.label for c in curves])
    polar, plane = [], []
    for log, scale, end in ((False, "linear", "linear"), (True, "logarithmic", "log")):
        image = picture(f"Polar diagram {where}, {scale}", lobes.draw_polar, curves, log)
        polar.append(ReportFigure(f"polar-{end}", f"{caption.replace(BARS, '')}Polar, {scale}.", image, data))
        image = picture(f"f {where}, {scale}", lobes.draw_in_plane, curves, log, size=size)
        plane.append(ReportFigure(f"plane-{end}", f"{caption}{scale.capitalize()}.", image, data))
    return polar + plane


def _plane_caption(s: ReportSubject, e: Evaluation, name: str, lines: ModelValues | None) -> str:
    caption = f"In the plane of incidence, {s.in_channel}{e.lit}. "
    if s.table is not None and lines is not None:
        caption += f"Lines: {'the readings, ' + e.interpolation if name == INTERPOLATED else name}. "
    if e.near:
        bars = any(np.isfinite(near.u).any() for near in e.near.values())
        caption += f"Points: readings{_near_words(s)}{BARS * bars}. "
    return caption


def _plane_curves(
    s: ReportSubject, e: Evaluation, lines: ModelValues | None
) -> tuple[list[lobes.Curve], dict[str, Any]]:
    """(curves, their numbers): lines of a model and points of readings for each incidence."""
    curves, data = [], {"channel": s.channel, "lines": [], "readings": []}

    def add(kind: str, curve: lobes.Curve, theta_i: float) -> None:
        angles, f = np.round(curve.theta_o, 4), rounded(curve.f)
        more = {} if curve.u is None else {"u_f_per_sr": rounded(curve.u)}
        data[kind].append({"theta_i_deg": theta_i, "theta_o_deg": angles, "f_per_sr": f} | more)
        if kind == "lines" or np.isfinite(curve.f).any():
            curves.append(curve)

    for k, (theta_i, tone) in enumerate(zip(e.incidences, shades(s.look.colour, len(e.incidences)), strict=True)):
        label = f"θᵢ {theta_i:.4g}°"
        if lines is not None:
            angles = sampling.plane_angles(theta_i, bool(lines.maps_behind))
            line = lobes.Curve(angles, lines.curves[k], label, tone, theta_i=theta_i)
            add("lines", line, theta_i)
        if e.near:
            x, f, u = readings.in_plane_readings(e.near[theta_i])
            u = u[:, s.shown] if np.isfinite(u[:, s.shown]).any() else None
            name, incoming = (label, theta_i) if lines is None else ("_nolegend_", None)
            add("readings", lobes.Curve(x, f[:, s.shown], name, tone, marker="o", theta_i=incoming, u=u), theta_i)
    return curves, data


def _near_words(s: ReportSubject) -> str:
    off_plane = f"{readings.OFF_PLANE:g}° of the plane"
    if s.table is not None and s.table.layout.in_half_vectors:
        return f" within {readings.NEAR_INCIDENCE:g}° of the incidence and {off_plane}"
    return "" if s.table is None or s.table.layout.gridded else f" within {off_plane}"


def _map_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """f over the outgoing hemisphere: readings as dots, the model as a map, on one colour scale."""
    near = [(t, side) for t in e.map_incidences if e.near for side in e.near[t].by_side()]
    near = [(t, behind, side.of_channel(s.shown, MOST_DOTS)) for t, (behind, side) in near]
    dots = [(t, behind, shown) for t, behind, shown in near if shown.f.size]
    discs = [
        (k, name, t, behind, f)
        for k, (name, m) in enumerate(e.models)
        for behind, of_side in ((False, m.maps), (True, m.maps_behind))
        for t, f in zip(e.map_incidences, of_side, strict=False)
        if f.any() or not m.maps_behind
    ]
    if not dots and not discs:
        return []
    scale = maps.colour_range(np.concatenate([*(shown.f for *_, shown in dots), *(f for *_, f in discs)]))
    made = []
    where = f"of {s.name} over the outgoing hemisphere{e.lit}, incidence"
    for theta_i, behind, shown in dots:
        label = f"Readings {where} {theta_i:.4g}°{THROUGH * behind}"
        image = picture(label, maps.draw_dots, *shown[:3], scale, theta_i, behind, size=maps.MAP_SIZE)
        theta_o = 180.0 - shown.theta_o if behind else shown.theta_o
        numbers = zip(("theta_o_deg", "delta_phi_deg", "f_per_sr"), map(rounded, (theta_o, *shown[1:3])), strict=True)
        data = {"theta_i_deg": theta_i, **dict(numbers)}
        slug = f"readings-{theta_i:.4g}" + "-behind" * behind
        made.append(ReportFigure(slug, "Readings.", image, data, "small"))
    for k, name, theta_i, behind, f in discs:
        label = f"f {where} {theta_i:.4g}°{THROUGH * behind}, {name}"
        image = picture(label, maps.draw_map, f, scale, theta_i, behind, size=maps.MAP_SIZE)
        data = {"theta_i_deg": theta_i, "pixels_across": maps.SIDE, "f_per_sr": rounded(f, 4)}
        data |= {"behind": True} if behind else {}
        slug = f"map-{theta_i:.4g}" + (f"-{k + 1}" if k else "") + "-behind" * behind
        made.append(ReportFigure(slug, f"{name[0].upper()}{name[1:]}.", image, data, "small"))
    caption = f"f over the outgoing hemisphere from above (equal areas are equal solid angles), {s.in_channel}{e.lit}; "
    caption += "○ light, + mirror direction, grey: no positive value."
    if any(behind for _, behind, _ in dots) or any(behind for *_, behind, _ in discs):
        caption += " Through: as seen through the sample from the side of the light, + straight through."
    bar = picture(f"Colour scale of f in 1/sr{e.lit}", maps.draw_scale, scale, size=maps.SCALE_SIZE)
    data = {"low_per_sr": scale[0], "high_per_sr": scale[1]}
    return [*made, ReportFigure("map-scale", caption, bar, data, "bar")]


def _space_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """The lobe in space, to be turned by hand; the picture is for paper."""
    sources = [(name, values) for name, values in e.sources if _known_of_a_side(values) >= LEAST_KNOWN]
    high = max((_highest(f) for _, values in sources for f in values.meshes), default=0.0)
    if not high > 0:
        return []
    k = len(e.incidences) // 2
    name, first = sources[0]
    mesh = _mesh(e.incidences[k], first, k)["f"]
    positive = mesh[np.isfinite(mesh) & (mesh > 0)]
    log = bool(positive.size and positive.max() > PEAKED * np.median(positive))
    listed = []
    for label, values in sources:
        meshes = [(t, _mesh(t, values, k)) for k, t in enumerate(e.incidences)]
        numbers = [
            {
                "theta_i_deg": t, "theta_o_deg": rounded(m["theta"], 5), "delta_phi_deg": rounded(m["phi"], 5),
                "f_per_sr": rounded(m["f"], 4),
            }
            for t, m in meshes
        ]  # fmt: skip
        listed.append({"name": label, "incidences": numbers})
    data = {"channel": s.channel, "highest_per_sr": high, "logarithmic": log, "sources": listed}
    label = f"Lobe of {s.name} in space{e.lit}, incidence {e.incidences[k]:.4g}°, {name}"
    top = float(positive.max()) if positive.size else high
    through = any(values.maps_behind for _, values in sources)
    size = lobes.SPACE_SIZE_THROUGH if first.maps_behind else lobes.SPACE_SIZE
    image = picture(label, lobes.draw_lobe, e.incidences[k], mesh, top, log, size=size)
    caption = f"The lobe in space, {s.in_channel}{e.lit}" + "; below the circle what goes through" * through
    if name == INTERPOLATED:
        caption += f"; {e.interpolation}; open where nothing was read"
    return [ReportFigure("lobe", f"{caption}.", image, data, "space")]


def _highest(f: np.ndarray) -> float:
    return float(f.max(initial=0.0, where=np.isfinite(f)))


def _mesh(theta_i: float, values: ModelValues, k: int) -> dict[str, np.ndarray]:
    """The mesh of the k-th incidence, degrees; open on the horizon between the sides, where nothing leaves."""
    theta, phi = lobes.mesh_angles(theta_i, bool(values.maps_behind))
    f = values.meshes[k].reshape(theta.size, phi.size)
    return {"theta": theta, "phi": phi, "f": np.where(theta[:, None] == 90.0, np.nan, f)}


def _known_of_a_side(values: ModelValues) -> float:
    """Share of the outgoing hemisphere in which f is known, on that side where it is larger."""
    halves = [np.array_split(f, 2) if values.maps_behind else [f] for f in values.meshes]
    return max(known_share(side) for side in zip(*halves, strict=True))


def _slice_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """f over half and difference angle at φd = 90°: of readings and of the models, on one colour scale."""
    slices = [(name, values.slice) for name, values in e.sources if known_share([values.slice]) >= LEAST_OF_SLICE]
    if not any((f > 0).any() for _, f in slices):
        return []
    scale = maps.slice_range([f for _, f in slices])
    made = []
    for k, (name, f) in enumerate(slices):
        label = f"f of {s.name} over half and difference angle at a difference azimuth of 90°{e.lit}, {name}"
        data = {
            "phi_d_deg": 90.0, "channel": s.channel, "theta_h_deg": rounded(maps.HALF, 5),
            "theta_d_deg": rounded(maps.DIFFERENCE, 5), "f_per_sr": rounded(f.reshape(len(maps.HALF), -1), 4),
        }  # fmt: skip
        caption = f"f over half and difference angle at φd = 90°, {s.in_channel}{e.lit}: {name}."
        caption += f" Colours by what is within {maps.SHOWN:g}°." + BLANK * bool(np.isnan(f).any())
        number = k + 1 - (slices[0][0] == INTERPOLATED)
        slug = "slice-readings" if name == INTERPOLATED else "slice-model" + (f"-{number}" if number > 1 else "")
        made.append(ReportFigure(slug, caption, picture(label, maps.draw_slice, f, scale), data))
    return made


def _disc_figures(s: ReportSubject, _: Evaluation) -> list[ReportFigure]:
    """A grooved or brushed disc under a lamp, of an anisotropic model with wavelengths."""
    material = s.material
    if material is None or material.expression is None or material.brdf.isotropic or s.channels.wavelengths_nm is None:
        return []
    lit = disc.lit_disc(material)
    image = picture(f"A disc of {s.name} under a lamp", disc.draw_disc, lit.rgba, size=disc.SIZE)
    caption = f"A disc whose local x axis points outwards, a lamp behind it: {lit.words}."
    data = {"eye_radii": list(disc.EYE), "lamp_radii": list(disc.LAMP), "wavelengths_nm": disc.FINEST.tolist()}
    return [ReportFigure("disc", caption, image, data)]


def _sphere_figures(s: ReportSubject, e: Evaluation) -> list[ReportFigure]:
    """Lit spheres of readings and of the models."""
    sources = [(name, values) for name, values in e.sources if values.known_of_sphere >= LEAST_KNOWN]
    dark = [bool(v.maps_behind) and not any(np.nan_to_num(p).any() for p in v.spheres) for _, v in sources]
    sources = [source for source, nothing in zip(sources, dark, strict=True) if not nothing]
    if not sources:
        return []
    matrix, words = channel_colour(s.channels)
    colour = words if matrix is not None else f"{s.in_channel} as grey ({words})"
    caption = (
        f"Lit spheres, {colour}{e.lit}; white is a perfect diffuser that faces the light, and what is brighter is "
    )
    caption += "cut off." + " Pale: not read." * any(np.isnan(p).any() for _, values in sources for p in values.spheres)
    pixels = [[spheres.sphere_pixels(p) for p in values.spheres] for _, values in sources]
    names = [name for name, _ in sources]
    rows = list(zip(names if len(names) > 1 else [""], pixels, strict=True))
    data = {"lights_deg": [{"from_the_eye": p, "raised": h} for p, h in spheres.LIGHTS], "rows": names}
    image = picture(f"Lit spheres of {s.name}{e.lit}", spheres.draw_spheres, rows, size=spheres.spheres_size(len(rows)))
    return [ReportFigure("spheres", caption, image, data)]
