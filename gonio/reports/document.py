"""The document: all that a page says, as JSON can hold it; the page is written from it and holds nothing else."""

import datetime
import platform
from collections.abc import Sequence
from typing import Any, NamedTuple

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
from gonio.text import versions

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
    drawable = [(s, e) for s, e in evaluated if e is not None]
    compared = comparison_figures(drawable)
    figures = _with_ids("all", compared)
    sections = []
    for s, e in evaluated:
        fit = fit_facts(s)
        of_subject = [] if e is None else _figures(s, e, fit)
        figures |= _with_ids(s.anchor, of_subject)
        sections.append(_section(s, e, fit) | {"figures": _listed(of_subject)})
    values = {
        "gonio_report": FORMAT,
        "title": title,
        "made": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "command": command,
        "versions": versions("jax", "numpy", "matplotlib") | {"system": f"{platform.system()} {platform.machine()}"},
        "columns": _columns(sections),
        "subjects": sections,
        "comparison": {"figures": _listed(compared)},
        "charts": [{k: v for k, v in c.items() if k != "picture"} for c in charts],
    }
    spheres = {s.anchor: image for s, e in drawable if (image := sphere_of(s, e))}
    return Document(plain(values), figures, spheres, charts)


def _is_empty(s: ReportSubject) -> bool:
    return s.table is not None and s.table.counts()["valid"] == 0


def _section(s: ReportSubject, e: Evaluation | None, fit: dict[str, Any] | None) -> dict[str, Any]:
    """Everything in the section of a subject but the figures."""
    rows = facts(s)
    style = colour_of(s.number)
    return {
        "anchor": s.anchor,
        "name": s.name,
        "kind": s.kind,
        "colour": style.colour,
        "dash": list(style.lengths),
        "channels": list(s.channels.names),
        "wavelengths_nm": s.channels.wavelengths_nm,
        "shown_channel": s.channel,
        "sentence": sentence(s, rows, fit),
        "notes": [] if e is None or s.table is None else [_interpolation_note(e)],
        "facts": rows,
        "certificate": None if s.certificate is None else s.certificate.to_dict(),
        "overall_basis": None if s.certificate is None else s.certificate.basis,
        "hemispherical": _hemispherical(s),
        "fit": fit,
        "provenance": provenance(s),
    }


def _figures(s: ReportSubject, e: Evaluation, fit: dict[str, Any] | None) -> list[ReportFigure]:
    of_values = (plane_figures, space_figures, map_figures, sphere_figures, slice_figures)
    figures = [f for make in of_values for f in make(s, e)] + albedo_figures(s) + reciprocity_figures(s)
    return figures + residual_figures(s, (fit or {}).get("theta_max")) + correlation_figures(s, fit)


def _interpolation_note(e: Evaluation) -> str:
    without = "; no sphere, lobe in space or slice of the readings is drawn" if e.interpolated is None else ""
    return f"Between the readings: {e.interpolation}{without}."


def _with_ids(anchor: str, figures: Sequence[ReportFigure]) -> dict[str, ReportFigure]:
    for f in figures:
        f.id = f"{anchor}-{f.slug}"
    return {f.id: f for f in figures}


def _listed(figures: Sequence[ReportFigure]) -> list[dict[str, Any]]:
    return [{"id": f.id, "kind": f.kind, "caption": f.caption, "data": f.data} for f in figures]


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
