"""The page: sections of figures and facts for each subject, put into the template."""

import datetime
import importlib.resources
import json
from typing import Any

import numpy as np

from gonio import __version__
from gonio import report_data as data
from gonio.cli.text import number
from gonio.data.plain import plain
from gonio.figures.albedo import AlbedoCurve, albedo_figure, channel_colours
from gonio.figures.hemisphere import colour_bar, colour_range, hemisphere_dots, hemisphere_map
from gonio.figures.lobes import Curve, in_plane, polar
from gonio.figures.residuals import residual_histogram, residual_map
from gonio.figures.style import colour_of, shades
from gonio.report_data import Subject

MARKS = {"pass": "✓", "fail": "✗", "undecided": "?", "not applicable": "–"}


def page(subjects: list[Subject], title: str, command: str | None) -> str:
    """The HTML of a report; everything that came from files is escaped by the template."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = number
    folder = importlib.resources.files("gonio") / "templates"
    template = environment.from_string((folder / "report.html.j2").read_text(encoding="utf-8"))
    sections = [_section(s) for s in subjects]
    values = {s["anchor"]: s.pop("values") for s in sections}
    made = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    # A "<" inside of a script element could end it, whatever a name in a stranger's file says.
    embedded = json.dumps(plain(values), ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace(
        "<", "\\u003c"
    )
    return template.render(
        title=title, sections=sections, command=command, made=made, version=__version__, values=embedded, marks=MARKS
    )


def _section(s: Subject) -> dict[str, Any]:
    colour, _ = colour_of(s.number)
    incidences = data.table_incidences(s.table, data.INCIDENCES) if s.table is not None else list(data.INCIDENCES)
    maps_at = data.table_incidences(s.table, data.MAP_INCIDENCES) if s.table is not None else list(data.MAP_INCIDENCES)
    channel = s.channels.names[s.shown]
    drawn = s.brdf if s.table is None else s.fitted
    curves, maps = data.model_views(drawn, incidences, maps_at) if drawn is not None else ([], [])
    near = data.readings_near(s.table, sorted({*incidences, *maps_at})) if s.table is not None else []
    by_incidence = dict(zip(sorted({*incidences, *maps_at}), near, strict=True)) if near else {}
    section = {
        "name": s.name,
        "anchor": f"subject-{s.number + 1}",
        "colour": colour,
        "kind": "table" if s.table is not None else "model",
        "channel": channel,
        "facts": _facts(s),
        "certificate": None if s.certificate is None else s.certificate.to_dict(),
        "fit": _fit_facts(s),
        "provenance": _provenance(s),
        "figures": _lobes(s, colour, channel, incidences, curves, by_incidence)
        + _maps(s, channel, maps_at, maps, by_incidence)
        + _albedo(s, colour)
        + _residuals(s, colour),
    }
    section["drawn"] = {n["name"]: n for n in ((section["fit"] or {}).get("bootstrap") or {}).get("numbers", [])}
    section["sentence"] = _sentence(s, section)
    section["values"] = {
        "name": s.name,
        "channels": s.channels.names,
        "certificate": section["certificate"],
        "fit": section["fit"],
        "facts": section["facts"],
        "provenance": section["provenance"],
        "in_plane": [
            {"theta_i_deg": t, "theta_o_deg": np.round(data.plane_angles(t), 4), "f_per_sr": _short(c)}
            for t, c in zip(incidences, curves, strict=False)
        ],
        "readings_in_plane": [
            {"theta_i_deg": t, "theta_o_deg": np.round(x, 4), "f_per_sr": _short(f)}
            for t in incidences
            if by_incidence
            for x, f in [data.in_plane_points(by_incidence[t])]
        ],
    }
    return section


def _short(f: np.ndarray) -> list:
    return [[None if not np.isfinite(v) else float(f"{v:.6g}") for v in row] for row in np.asarray(f, float)]


def _sentence(s: Subject, section: dict) -> str:
    said = []
    if s.table is not None:
        c = section["facts"]
        said.append(f"{c['valid readings']} valid readings in {c['channels']}, layout {c['layout']}.")
        if c["negative readings"] != "0":
            said.append(f"{c['negative readings']} readings are negative; they are kept as read.")
    elif s.material is not None and s.material.description:
        said.append(s.material.description.rstrip(".") + ".")
    fit = section["fit"]
    if fit:
        verdict = "converged" if fit.get("converged") else f"did not converge ({fit.get('reason', 'no reason given')})"
        rms = fit.get("metrics", {}).get("relative_rms")
        said.append(f"The fit of {fit.get('asked', 'a model')} {verdict}, relative rms {number(rms, 3)}.")
    return " ".join(said)


def _facts(s: Subject) -> dict[str, str]:
    names = s.channels.names
    listed = f"{len(names)} channel{'s' * (len(names) > 1)} ({', '.join(names[:8])}{', …' if len(names) > 8 else ''})"
    if s.table is None:
        from gonio.models.building import spell
        from gonio.models.errors import GonioError

        try:
            model = (s.material.spelling if s.material else None) or spell(s.brdf)
        except GonioError:
            model = type(s.brdf).__name__
        return {"model": model, "channels": listed}
    counts = s.table.counts()
    facts = {
        "layout": s.table.layout.name.replace("_", "/"),
        "cells": f"{counts['cells']:,}",
        "channels": listed,
        "valid readings": f"{counts['valid']:,}",
        "negative readings": f"{counts['negative']:,}",
    }
    for flag in ("below_horizon", "shadowed", "saturated", "not_measured", "invalid"):
        if counts[flag]:
            facts[flag.replace("_", " ")] = f"{counts[flag]:,}"
    for what, sr in (("source", s.table.source_solid_angle), ("receiver", s.table.receiver_solid_angle)):
        facts[f"{what} solid angle"] = "not stated" if sr is None else "a point" if sr == 0 else f"{sr:.4g} sr"
    return facts


def _fit_facts(s: Subject) -> dict[str, Any] | None:
    if s.fit is not None:
        return {**plain(s.fit.to_dict()), "spelling": s.fit.spelling}
    owner = s.fit_material or (s.material if s.table is None else None)
    if owner is None or "fit" not in owner.meta:
        return None
    return {**plain(owner.meta["fit"]), "spelling": owner.spelling}


def _provenance(s: Subject) -> list[tuple[str, str]]:
    if s.table is None:
        source = s.material.source if s.material else ""
        return [("source", source)] if source else []
    rows = []
    for key, value in s.table.provenance.items():
        text = _spoken(plain(value))
        rows.append((str(key), text if len(text) <= 2000 else text[:2000] + " …"))
    return rows


def _spoken(value: Any) -> str:
    if isinstance(value, dict):
        return "; ".join(f"{k.replace('_', ' ')} {_spoken(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(_spoken(v) for v in value)
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def _lobes(s: Subject, colour: str, channel: str, incidences, curves, by_incidence) -> list[dict]:
    drawn = []
    tones = shades(colour, len(incidences))
    for k, theta_i in enumerate(incidences):
        label = f"θᵢ {theta_i:.4g}°"
        if curves:
            angles = data.plane_angles(theta_i)
            drawn.append(Curve(angles, curves[k][:, _column(curves[k], s.shown)], label, tones[k], theta_i=theta_i))
        if by_incidence:
            x, f = data.in_plane_points(by_incidence[theta_i])
            if x.size:
                name = "_nolegend_" if curves else label
                drawn.append(Curve(x, f[:, s.shown], name, tones[k], marker="o", theta_i=None if curves else theta_i))
    if not drawn:
        return []
    what = f"of {s.name}, channel {channel}, in the plane of incidence"
    lines = "Lines: the fitted model. " if s.table is not None and curves else ""
    points = f"Points: readings{_how_near(s)}. " if by_incidence else ""
    caption = f"In the plane of incidence, channel {channel}. {lines}{points}"
    return [
        {"svg": polar(drawn, f"Polar diagram {what}, linear", False), "caption": caption + "Polar, linear."},
        {"svg": polar(drawn, f"Polar diagram {what}, logarithmic", True), "caption": caption + "Polar, logarithmic."},
        {"svg": in_plane(drawn, f"f {what}, linear", False), "caption": caption + "Linear."},
        {"svg": in_plane(drawn, f"f {what}, logarithmic", True), "caption": caption + "Logarithmic."},
    ]


def _how_near(s: Subject) -> str:
    if s.table.layout.name == "half_difference":
        return f" within {data.NEAR_INCIDENCE:g}° of the incidence and {data.OFF_PLANE:g}° of the plane"
    if s.table.layout.name == "scattered":
        return f" within {data.OFF_PLANE:g}° of the plane"
    return ""


def _column(values: np.ndarray, channel: int) -> int:
    return channel if values.shape[1] > 1 else 0


def _maps(s: Subject, channel: str, maps_at, maps, by_incidence) -> list[dict]:
    pictures = []
    everything = [m[:, _column(m, s.shown)] for m in maps]
    everything += [by_incidence[t]["f"][:, s.shown] for t in maps_at if by_incidence]
    if not everything:
        return []
    scale = colour_range(np.concatenate(everything))
    for theta_i in maps_at if by_incidence else []:
        near = by_incidence[theta_i]
        f = near["f"][:, s.shown]
        kept = np.isfinite(f)
        if kept.any():
            angles = (np.radians(near[a][kept]) for a in ("theta_o", "delta_phi"))
            label = f"Readings of {s.name} over the outgoing hemisphere, incidence {theta_i:.4g}°"
            pictures.append({"svg": hemisphere_dots(*angles, f[kept], scale, theta_i, label), "caption": "Readings."})
    for theta_i, m in zip(maps_at, maps, strict=False):
        label = f"f of {s.name} over the outgoing hemisphere, incidence {theta_i:.4g}°"
        what = "Fitted model." if s.table is not None else "Model."
        f = m[:, _column(m, s.shown)]
        pictures.append({"svg": hemisphere_map(f, scale, theta_i, label), "caption": what})
    caption = (
        f"f over the outgoing hemisphere from above (equal areas are equal solid angles), channel {channel}; "
        "○ light, + mirror direction, grey: no positive value."
    )
    return [{"row": pictures, "bar": colour_bar(scale, "Colour scale of f in 1/sr"), "caption": caption}]


def _albedo(s: Subject, colour: str) -> list[dict]:
    series = (
        {} if s.certificate is None else next((p.series for p in s.certificate.properties if p.name == "energy"), {})
    )
    if not series.get("theta_i_deg"):
        return []
    theta = np.asarray(series["theta_i_deg"], float)
    albedo, bound = (_by_channel(series[k], theta.size) for k in ("albedo", "bound"))
    names = s.channels.names if albedo.shape[0] == len(s.channels) else ("grey",)
    pick = np.unique(np.linspace(0, len(names) - 1, min(len(names), 6)).astype(int))
    colours = channel_colours(colour, tuple(names[k] for k in pick))
    marker = "o" if s.table is not None else None
    curves = [AlbedoCurve(theta, albedo[k], bound[k], names[k], c, marker) for k, c in zip(pick, colours, strict=True)]
    label = f"Directional albedo of {s.name} against the angle of incidence"
    caption = "Directional albedo (the share of light that is reflected) with its bound; the dashed line is 1."
    if not all(np.isfinite(c.bound).all() for c in curves):
        caption += " Where no band is drawn the albedo has no bound: the grid does not resolve the lobe there."
    return [{"svg": albedo_figure(curves, label), "caption": caption}]


def _by_channel(values: list, size: int) -> np.ndarray:
    a = np.array([[np.nan if v is None else v for v in np.atleast_1d(row)] for row in values], float)
    return a if a.shape[1] == size else a.reshape(-1, size)


def _residuals(s: Subject, colour: str) -> list[dict]:
    if s.table is None or s.fitted is None:
        return []
    theta_max = (_fit_facts(s) or {}).get("theta_max")
    r = data.residuals(s.table, s.fitted, theta_max)
    cut = "" if theta_max is None else f", polar angles up to {np.degrees(theta_max):.4g}° as in the fit"
    if not r["relative"].size:
        return []
    figures = [
        {
            "svg": residual_map(r[axes[0]], r[axes[1]], r["relative"], f"Residuals of the fit to {s.name}", axes),
            "caption": f"Fit residuals by {words}, all channels{cut}: red: model brighter.",
        }
        for axes, words in (
            (("theta_h", "theta_d"), "half and difference angle"),
            (("theta_i", "theta_o"), "incident and outgoing angle"),
        )
    ]
    in_u = r["in_u"].size > 0.5 * r["relative"].size
    values, unit = (r["in_u"], "u_f") if in_u else (100 * r["relative"], "%")
    caption = "Residuals in standard uncertainties of the readings" if in_u else "Relative residuals, all channels"
    figures.append(
        {
            "svg": residual_histogram(values, unit, colour, f"Histogram of residuals of {s.name}"),
            "caption": caption + cut + ".",
        }
    )
    return figures
