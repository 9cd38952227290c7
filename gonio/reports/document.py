"""The document: all that a page says, as JSON can hold it; facts, fits and provenance of each subject."""

import datetime
import hashlib
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.material import Material
from gonio.data.profile import Profile
from gonio.data.serialise import plain
from gonio.figures.sampling import LEAST_KNOWN
from gonio.fitting.judgement import judge_fit
from gonio.fitting.residuals.energy import bounded_largest_albedo
from gonio.metrology.standards.shared import shared_integrals
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.expression.builder import to_expression
from gonio.reports import (
    budget_section,
    check_figures,
    fit_figures,
    lobe_figures,
    profile_figures,
    quantities_section,
    reading_figures,
    render_figures,
    scatter_figures,
)
from gonio.reports.evaluation import Evaluation, ReportFigure, evaluate_subject
from gonio.reports.subject import ReportSubject
from gonio.text import versions

FORMAT = 1
MOST_TEXT = 2000
NAMES_LISTED = 8
ON_THE_SPOT = "spelled on the spot"  # the description of a material that an expression made


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


class _Drawn(NamedTuple):
    """What is drawn of a subject before its certificate is made."""

    fits: list[dict[str, Any]]
    of_lobes: list[ReportFigure]
    of_fits: list[ReportFigure]


def assemble(
    subjects: Sequence[ReportSubject],
    title: str,
    command: str | None,
    charts: list[dict[str, Any]],
    certify: Callable[[Sequence[ReportSubject]], None] = lambda subjects: None,
    step: Callable[[str, ReportSubject], None] = lambda what, s: None,
    render: bool = False,
) -> Document:
    """Evaluates the subjects, and draws and lists everything that the page holds; `step` is told what comes next.

    `certify` makes the certificates that are missing, while another process may draw what needs none. `render`: with
    a sphere of each by Mitsuba.
    """
    evaluated, first = [], []
    for s in subjects:
        step("evaluating", s)
        e = None if s.empty or s.profile is not None else evaluate_subject(s)
        evaluated.append((s, e))
        first.append(_figures(s, e, fit_facts(s)))
    certify(subjects)
    drawable = [(s, e) for s, e in evaluated if e is not None]
    compared = _named("all", check_figures.comparison_figures(drawable))
    sections, figures = [], dict(compared)
    for (s, e), (fits, of_lobes, of_fits) in zip(evaluated, first, strict=True):
        step("drawing", s)
        of_checks = [] if e is None else check_figures.figures(s)
        made = _named(s.anchor, [*of_lobes, *of_checks, *of_fits])
        if render and e is not None:
            step("rendering", s)
            made |= _named(s.anchor, render_figures.figures(s))
        figures |= made
        sections.append(_section(s, e, fits) | {"figures": _listed(made)})
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
    spheres = {s.anchor: image for s, e in drawable if (image := check_figures.sphere_of(s, e))}
    return Document(plain(values), figures, spheres, charts)


def _notes(s: ReportSubject, e: Evaluation | None) -> list[str]:
    """What the readings are suspected of, and how they are interpolated; where a model leaves what it is made for."""
    if s.profile is not None:
        return list(s.profile.provenance.get("warnings", []))
    if s.table is None:
        return list(s.model.validity_notes)
    return [*s.table.provenance.get("warnings", []), *([] if e is None else [_interpolation_note(e)])]


def _figures(s: ReportSubject, e: Evaluation | None, fits: list[dict[str, Any]]) -> _Drawn:
    of_lobes = profile_figures.figures(s)
    if e is None:
        return _Drawn(fits, of_lobes, [])
    of_lobes += reading_figures.figures(s) + lobe_figures.figures(s, e) + scatter_figures.figures(s, e)
    return _Drawn(fits, of_lobes, fit_figures.figures(s, fits))


def _section(s: ReportSubject, e: Evaluation | None, fits: list[dict[str, Any]]) -> dict[str, Any]:
    """Everything in the section of a subject but the figures."""
    with shared_integrals():
        of_standards = {"quantities": quantities_section.quantities_of(s), "budget": budget_section.budget_of(s)}
    rows = facts(s)
    return {
        "anchor": s.anchor,
        "name": s.name,
        "kind": s.kind,
        "subsurface": s.below_surface,
        "colour": s.look.colour,
        "dash": list(s.look.lengths),
        "channels": list(s.channels.names),
        "wavelengths_nm": s.channels.wavelengths_nm,
        "shown_channel": s.channel,
        "sentence": sentence(s, rows),
        "notes": _notes(s, e),
        "readings": reading_figures.listed(s),
        "pairs": check_figures.few_pairs(s),
        "facts": rows,
        "certificate": None if s.certificate is None else s.certificate.to_dict(),
        "overall_basis": None if s.certificate is None else s.certificate.basis,
        "hemispherical": _hemispherical(s),
        **of_standards,
        "fits": fits,
        "provenance": provenance(s),
    }


def _interpolation_note(e: Evaluation) -> str:
    if e.interpolated is None:
        return f"Nothing is drawn between the readings: {e.interpolation}."
    share = e.interpolated.known_of_sphere
    if share < LEAST_KNOWN:
        return f"No lit sphere of the readings is drawn: they cover {percent(share)} of one."
    return f"Between the readings: {e.interpolation}." + " Where nothing was read pictures are blank." * (share < 1)


def _named(anchor: str, figures: Sequence[ReportFigure]) -> dict[str, ReportFigure]:
    return {f"{anchor}-{f.slug}": f for f in figures}


def _listed(figures: Mapping[str, ReportFigure]) -> list[dict[str, Any]]:
    return [{"id": name, "kind": f.kind, "caption": f.caption, "data": f.data} for name, f in figures.items()]


def _columns(sections: Sequence[dict[str, Any]]) -> list[str]:
    """Properties that were judged of any subject, in the order of the certificates."""
    properties = [p for s in sections for p in (s["certificate"] or {"properties": []})["properties"]]
    judged = {p["name"] for p in properties if p["verdict"] != "not applicable"}
    return [name for name in dict.fromkeys(p["name"] for p in properties) if name in judged]


def _hemispherical(s: ReportSubject) -> list[dict[str, Any]]:
    """Albedo under uniform light by channel, with its bound, where the certificate has it."""
    energy = check_figures.property_of(s, "energy")
    values = None if energy is None else energy.facts.get("hemispherical_albedo")
    if energy is None or values is None:
        return []
    bounds = energy.facts.get("hemispherical_bound") or [None] * len(values)
    names = energy.facts.get("of_channels") or (s.channels.names if len(values) == len(s.channels) else ["grey"])
    return [{"channel": n, "albedo": v, "bound": b} for n, v, b in zip(names, values, bounds, strict=True)]


def facts(s: ReportSubject) -> list[dict[str, Any]]:
    """Rows of what a subject is: `name`, `value`, and `unit` where there is one."""
    names = s.channels.names
    listed = ", ".join(names[:NAMES_LISTED]) + (", …" if len(names) > NAMES_LISTED else "")
    channels = {"name": "channels", "value": len(names), "note": listed}
    if s.profile is not None:
        return _profile_facts(s.profile, channels)
    if s.table is None:
        return [{"name": "model", "value": expression(s), "code": True}, channels]
    counts = s.table.counts()
    rows = [
        {"name": "layout", "value": s.table.layout.name.replace("in_", "in-").replace("_", "/")},
        {"name": "cells", "value": counts["cells"]},
        channels,
        {"name": "valid readings", "value": counts["valid"]},
        {"name": "negative readings", "value": counts["negative"]},
    ]
    flags = ("below_horizon", "shadowed", "saturated", "not_measured", "invalid")
    rows += [{"name": flag.replace("_", " "), "value": counts[flag]} for flag in flags if counts[flag]]
    for what, sr in (("source", s.table.source_solid_angle), ("receiver", s.table.receiver_solid_angle)):
        value = "not stated" if sr is None else "a point" if sr == 0 else float(sr)
        rows.append({"name": f"{what} solid angle", "value": value} | ({"unit": "sr"} if sr else {}))
    rows.append({"name": "uncertainties stored", "value": "no" if s.table.u_f is None else "yes"})
    return rows


def _profile_facts(p: Profile, channels: dict[str, Any]) -> list[dict[str, Any]]:
    known = p.facts()
    rows = [{"name": "offsets", "value": known["offsets"]}, channels]
    for what, radius in (("lit", p.illuminated_radius), ("viewed", p.viewed_radius)):
        value = {"value": "a point"} if radius == 0 else {"value": float(radius), "unit": "mm"}
        rows.append({"name": f"radius of the {what} spot", **value})
    negative = int(np.count_nonzero(p.valid & (p.value < 0)))
    rows += [{"name": "valid readings", "value": int(p.valid.sum())}, {"name": "negative readings", "value": negative}]
    flags = {name: int(np.count_nonzero(p.flag == flag)) for name, flag in Flag.__members__.items()}
    rows += [{"name": n.lower().replace("_", " "), "value": k} for n, k in flags.items() if k and n != "VALID"]
    return [*rows, {"name": "uncertainty", "value": known["uncertainty"]}]


def expression(s: ReportSubject) -> str:
    """The expression of a model, or the name of its class."""
    try:
        return (s.material.expression if s.material else None) or to_expression(s.model)
    except GonioError:
        return type(s.model).__name__


def fit_facts(s: ReportSubject) -> list[dict[str, Any]]:
    """Everything that each fit reports, with the expression of its model and a judgement; of a fitted model its own."""
    fitted = s.fits or ([s.material] if s.material is not None and "fit" in s.material.meta else [])
    return [_fit_facts(material) for material in fitted]


def _fit_facts(material: Material) -> dict[str, Any]:
    values = {**plain(material.meta["fit"]), "spelling": material.expression}
    if isinstance(values.get("free_names"), list):
        values["free_count"] = len(values["free_names"])
    if "largest_albedo" not in (metrics := values.get("metrics", {})):  # a file from before it was computed
        values["metrics"] = metrics | {"largest_albedo": bounded_largest_albedo(material.brdf).value}
    # By what the file reports, not by what it calls itself.
    return values | {"judgement": judge_fit(values)._asdict()}


def provenance(s: ReportSubject) -> list[dict[str, str]]:
    """Rows of where a subject comes from: its file with its fingerprint, then its stored provenance."""
    rows = []
    if s.file:
        path = Path(s.file)
        rows.append({"name": "file", "value": f"{path.name}, {path.stat().st_size:,} bytes"})
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        rows.append({"name": "SHA-256", "value": digest, "code": True})
    stored = s.profile or s.table
    if stored is None:
        if s.material and s.material.source:
            rows.append({"name": "source", "value": s.material.source})
        return rows
    for key, value in stored.provenance.items():
        text = _as_text(plain(value))
        rows.append({"name": str(key), "value": text if len(text) <= MOST_TEXT else text[:MOST_TEXT] + " …"})
    return rows


def _as_text(value: Any) -> str:
    if isinstance(value, dict):
        return "; ".join(f"{k.replace('_', ' ')} {_as_text(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(_as_text(v) for v in value)
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def sentence(s: ReportSubject, rows: list[dict]) -> str:
    """The first sentences of a subject's section."""
    sentences = []
    if s.profile is not None:
        known = s.profile.facts()
        sentences.append(f"R, light that leaves beside a lit spot, by the distance: {known['readings']} readings.")
    elif s.table is not None:
        value = {r["name"]: r["value"] for r in rows}
        channels = f"{value['channels']} channel{'s' * (value['channels'] > 1)}"
        if not value["valid readings"]:
            where = f"{value['cells']:,} cells and {channels}"
            sentences.append(f"No valid reading in {where}: nothing can be judged or drawn.")
        else:
            sentences.append(f"{value['valid readings']:,} valid readings in {channels}, layout {value['layout']}.")
        if value["negative readings"]:
            sentences.append(f"{value['negative readings']:,} readings are negative; they are kept as read.")
    elif s.material is not None and s.material.description and s.material.description != ON_THE_SPOT:
        sentences.append(s.material.description.rstrip(".") + ".")
    return " ".join(sentences)
