"""The document: all that a page says, as JSON can hold it; the page is written from it and holds nothing else."""

import datetime
import platform
from collections.abc import Sequence
from typing import Any, NamedTuple

from gonio import __version__
from gonio.data.serialise import plain
from gonio.figures.style import colour_of
from gonio.reports.check_figures import (
    albedo_figures,
    correlation_figures,
    property_of,
    reciprocity_figures,
    residual_figures,
)
from gonio.reports.comparison import comparison_figures, sphere_of
from gonio.reports.evaluations import Evaluation, evaluate_subject
from gonio.reports.facts import facts, fit_facts, provenance, sentence
from gonio.reports.figure import ReportFigure
from gonio.reports.lobe_figures import map_figures, plane_figures, slice_figures, space_figures, sphere_figures
from gonio.reports.subject import ReportSubject

FORMAT = 1


class Document(NamedTuple):
    """A report before it is written as a page."""

    values: dict[str, Any]
    """What stands in OUT.json."""
    figures: dict[str, ReportFigure]
    """By their id."""
    spheres: dict[str, str]
    """Addresses of images, by the anchor of their subject."""
    charts: list[dict[str, Any]]
    """Charts of speed against accuracy, with their pictures."""


def assemble(
    subjects: Sequence[ReportSubject], title: str, command: str | None, charts: list[dict[str, Any]]
) -> Document:
    """Evaluates the subjects, and draws and lists everything that the page holds."""
    evaluated = [(s, None if _is_empty(s) else evaluate_subject(s)) for s in subjects]
    sections = [(s, *_section(s, e)) for s, e in evaluated]
    drawable = [(s, e) for s, e in evaluated if e is not None]
    compared = comparison_figures(drawable)
    figures = _with_ids("all", compared)
    for s, _, drawn in sections:
        figures |= _with_ids(s.anchor, drawn)
    values = {
        "gonio_report": FORMAT,
        "title": title,
        "made": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": command,
        "versions": versions(),
        "columns": _columns([section for _, section, _ in sections]),
        "subjects": [section | {"figures": _listed(drawn)} for _, section, drawn in sections],
        "comparison": {"figures": _listed(compared)},
        "charts": [{k: v for k, v in c.items() if k != "picture"} for c in charts],
    }
    spheres = {s.anchor: image for s, e in drawable if (image := sphere_of(s, e))}
    return Document(plain(values), figures, spheres, charts)


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


def _is_empty(s: ReportSubject) -> bool:
    return s.table is not None and s.table.counts()["valid"] == 0


def _section(s: ReportSubject, e: Evaluation | None) -> tuple[dict[str, Any], list[ReportFigure]]:
    """(everything but the figures that a section says, its figures)."""
    fit = fit_facts(s)
    rows = facts(s)
    colour, dash = colour_of(s.number)
    values = {
        "anchor": s.anchor,
        "name": s.name,
        "kind": s.kind,
        "colour": colour,
        "dash": [] if isinstance(dash, str) else [float(v) for v in dash[1]],
        "channels": list(s.channels.names),
        "wavelengths_nm": None if s.channels.wavelengths_nm is None else list(s.channels.wavelengths_nm),
        "shown_channel": s.channel,
        "sentence": sentence(s, rows, fit),
        "notes": [] if e is None or s.table is None else [_interpolation_note(e)],
        "facts": rows,
        "certificate": None if s.certificate is None else s.certificate.to_dict(),
        "hemispherical": _hemispherical(s),
        "fit": fit,
        "provenance": provenance(s),
    }
    if e is None:
        return values, []
    return values, [
        *plane_figures(s, e),
        *space_figures(s, e),
        *map_figures(s, e),
        *sphere_figures(s, e),
        *slice_figures(s, e),
        *albedo_figures(s),
        *reciprocity_figures(s),
        *residual_figures(s, (fit or {}).get("theta_max")),
        *correlation_figures(s, fit),
    ]


def _interpolation_note(e: Evaluation) -> str:
    without = "; no sphere, lobe in space or slice of the readings is drawn" if e.interpolated is None else ""
    return f"Between the readings: {e.interpolation}{without}."


def _with_ids(anchor: str, drawn: Sequence[ReportFigure]) -> dict[str, ReportFigure]:
    for f in drawn:
        f.id = f"{anchor}-{f.slug}"
    return {f.id: f for f in drawn}


def _listed(drawn: Sequence[ReportFigure]) -> list[dict[str, Any]]:
    return [{"id": f.id, "kind": f.kind, "caption": f.caption, "data": f.data} for f in drawn]


def _columns(sections: Sequence[dict[str, Any]]) -> list[str]:
    """Properties that were judged of any subject, in the order of the certificates."""
    properties = [p for s in sections for p in (s["certificate"] or {"properties": []})["properties"]]
    judged = {p["name"] for p in properties if p["verdict"] != "not applicable"}
    return [name for name in dict.fromkeys(p["name"] for p in properties) if name in judged]


def _hemispherical(s: ReportSubject) -> list[dict[str, Any]]:
    """Albedo under uniform light by channel, with its bound, where the certificate has it."""
    energy = property_of(s, "energy")
    values = None if energy is None else energy.facts.get("hemispherical_albedo")
    if energy is None or values is None:
        return []
    bounds = energy.facts.get("hemispherical_bound") or [None] * len(values)
    names = s.channels.names if len(values) == len(s.channels) else ["grey"]
    return [{"channel": n, "albedo": v, "bound": b} for n, v, b in zip(names, values, bounds, strict=True)]
