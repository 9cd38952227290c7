"""The document: all that a page says, as JSON can hold it; the page is written from it and holds nothing else."""

import datetime
import platform
from typing import Any

from gonio import __version__
from gonio.data.serialise import plain
from gonio.figures.style import colour_of
from gonio.reports.check_figures import albedo_figures, correlation_figures, reciprocity_figures, residual_figures
from gonio.reports.comparison import sphere_of, together
from gonio.reports.evaluations import Seen, look
from gonio.reports.facts import facts, fit_facts, provenance, sentence
from gonio.reports.figure import Drawn
from gonio.reports.lobe_figures import map_figures, plane_figures, slice_figures, space_figures, sphere_figures
from gonio.reports.subject import Subject

FORMAT = 1


def assembled(
    subjects: list[Subject], title: str, command: str | None, charts: list[dict]
) -> tuple[dict[str, Any], dict[str, Drawn], dict[str, str]]:
    """(document, figures by their id, spheres by the anchor of their subject)."""
    seen = [None if _empty(s) else look(s) for s in subjects]
    figures: dict[str, Drawn] = {}
    sections = [_section(s, v, figures) for s, v in zip(subjects, seen, strict=True)]
    drawable = [(s, v) for s, v in zip(subjects, seen, strict=True) if v is not None]
    compared = together([s for s, _ in drawable], [v for _, v in drawable])
    spheres = {s.anchor: image for s, v in drawable if (image := sphere_of(s, v))}
    document = {
        "gonio_report": FORMAT,
        "title": title,
        "made": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": command,
        "versions": versions(),
        "columns": _columns(sections),
        "subjects": sections,
        "comparison": {"figures": [_listed(d, "all", figures) for d in compared]},
        "charts": [{k: v for k, v in c.items() if k != "picture"} for c in charts],
    }
    return plain(document), figures, spheres


def versions() -> dict[str, str]:
    """What the page was made with."""
    import jax
    import matplotlib
    import numpy

    return {
        "gonio": __version__,
        "python": platform.python_version(),
        "jax": jax.__version__,
        "numpy": numpy.__version__,
        "matplotlib": matplotlib.__version__,
        "system": f"{platform.system()} {platform.machine()}",
    }


def _empty(s: Subject) -> bool:
    return s.table is not None and s.table.counts()["valid"] == 0


def _section(s: Subject, seen: Seen | None, figures: dict[str, Drawn]) -> dict[str, Any]:
    fit = fit_facts(s)
    rows = facts(s)
    drawn = []
    if seen is not None:
        drawn = [
            *plane_figures(s, seen),
            *space_figures(s, seen),
            *map_figures(s, seen),
            *sphere_figures(s, seen),
            *slice_figures(s, seen),
            *albedo_figures(s),
            *reciprocity_figures(s),
            *residual_figures(s, (fit or {}).get("theta_max")),
            *correlation_figures(s, fit),
        ]
    notes = []
    if seen is not None and s.table is not None:
        without = "no sphere, lobe in space or slice of the readings is drawn"
        notes.append(f"Between the readings: {seen.how}" + ("." if seen.between is not None else f"; {without}."))
    return {
        "anchor": s.anchor,
        "name": s.name,
        "kind": s.kind,
        "colour": colour_of(s.number)[0],
        "dash": _dash(s.number),
        "channels": list(s.channels.names),
        "wavelengths_nm": None if s.channels.wavelengths_nm is None else list(s.channels.wavelengths_nm),
        "shown_channel": s.channel,
        "sentence": sentence(s, rows, fit),
        "notes": notes,
        "facts": rows,
        "certificate": None if s.certificate is None else s.certificate.to_dict(),
        "hemispherical": _hemispherical(s),
        "fit": fit,
        "provenance": provenance(s),
        "figures": [_listed(d, s.anchor, figures) for d in drawn],
    }


def _listed(d: Drawn, anchor: str, figures: dict[str, Drawn]) -> dict[str, Any]:
    d.id = f"{anchor}-{d.slug}"
    figures[d.id] = d
    return {"id": d.id, "kind": d.kind, "caption": d.caption, "data": d.data}


def _dash(number: int) -> list[float]:
    dash = colour_of(number)[1]
    return [] if dash == "-" else [float(v) for v in dash[1]]


def _columns(sections: list[dict]) -> list[str]:
    """Properties that were judged of any subject, in the order of the certificates."""
    names: dict[str, bool] = {}
    for s in sections:
        for p in (s["certificate"] or {"properties": []})["properties"]:
            names[p["name"]] = names.get(p["name"], False) or p["verdict"] != "not applicable"
    return [name for name, any_ in names.items() if any_]


def _hemispherical(s: Subject) -> list[dict[str, Any]]:
    """Albedo under uniform light by channel, with its bound, where the certificate has it."""
    energy = next((p for p in (s.certificate.properties if s.certificate else []) if p.name == "energy"), None)
    values = (energy.facts if energy else {}).get("hemispherical_albedo")
    if values is None:
        return []
    bounds = energy.facts.get("hemispherical_bound") or [None] * len(values)
    names = s.channels.names if len(values) == len(s.channels) else ["grey"]
    return [{"channel": n, "albedo": v, "bound": b} for n, v, b in zip(names, values, bounds, strict=True)]
