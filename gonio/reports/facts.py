"""Facts of a subject in words and numbers: properties, fit, provenance, and one sentence."""

import hashlib
from pathlib import Path
from typing import Any

from gonio.data.serialise import plain
from gonio.models.errors import GonioError
from gonio.models.expression.builder import to_expression
from gonio.reports.subject import ReportSubject
from gonio.text import number

MOST_TEXT = 2000
NAMES_LISTED = 8
ON_THE_SPOT = "spelled on the spot"  # the description of a material that an expression made


def facts(s: ReportSubject) -> list[dict[str, Any]]:
    """Rows of what a subject is: `name`, `value`, and `unit` where there is one."""
    names = s.channels.names
    listed = ", ".join(names[:NAMES_LISTED]) + (", …" if len(names) > NAMES_LISTED else "")
    channels = {"name": "channels", "value": len(names), "note": listed}
    if s.table is None:
        return [{"name": "model", "value": expression(s), "code": True}, channels]
    counts = s.table.counts()
    rows = [
        {"name": "layout", "value": s.table.layout.name.replace("_", "/")},
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


def expression(s: ReportSubject) -> str:
    """The expression of a model, or the name of its class."""
    try:
        return (s.material.expression if s.material else None) or to_expression(s.model)
    except GonioError:
        return type(s.model).__name__


def fit_facts(s: ReportSubject) -> dict[str, Any] | None:
    """Everything that a fit reports, with the expression of the model; None where there is no fit."""
    material = s.fit or s.material
    if material is None or "fit" not in material.meta:
        return None
    values = {**plain(material.meta["fit"]), "spelling": material.expression}
    if isinstance(values.get("free_names"), list):
        values["free_count"] = len(values["free_names"])
    return values


def provenance(s: ReportSubject) -> list[dict[str, str]]:
    """Rows of where a subject comes from: its file with its fingerprint, then its stored provenance."""
    rows = []
    if s.file:
        path = Path(s.file)
        rows.append({"name": "file", "value": f"{path.name}, {path.stat().st_size:,} bytes"})
        rows.append({"name": "SHA-256", "value": fingerprint(path), "code": True})
    if s.table is None:
        if s.material and s.material.source:
            rows.append({"name": "source", "value": s.material.source})
        return rows
    for key, value in s.table.provenance.items():
        text = _as_text(plain(value))
        rows.append({"name": str(key), "value": text if len(text) <= MOST_TEXT else text[:MOST_TEXT] + " …"})
    return rows


def fingerprint(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _as_text(value: Any) -> str:
    if isinstance(value, dict):
        return "; ".join(f"{k.replace('_', ' ')} {_as_text(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(_as_text(v) for v in value)
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def sentence(s: ReportSubject, rows: list[dict], fit: dict | None) -> str:
    """The first sentences of a subject's section."""
    sentences = []
    if s.table is not None:
        value = {r["name"]: r["value"] for r in rows}
        channels = f"{value['channels']} channel{'s' * (value['channels'] > 1)}"
        if not value["valid readings"]:
            nothing = f"No valid reading in {value['cells']:,} cells and {channels}: nothing can be judged or drawn."
            sentences.append(nothing)
        else:
            sentences.append(f"{value['valid readings']:,} valid readings in {channels}, layout {value['layout']}.")
        if value["negative readings"]:
            sentences.append(f"{value['negative readings']:,} readings are negative; they are kept as read.")
    elif s.material is not None and s.material.description and s.material.description != ON_THE_SPOT:
        sentences.append(s.material.description.rstrip(".") + ".")
    if fit:
        verdict = "converged" if fit.get("converged") else f"did not converge ({fit.get('reason', 'no reason given')})"
        rms = fit.get("metrics", {}).get("relative_rms")
        sentences.append(f"The fit of {fit.get('asked', 'a model')} {verdict}, relative rms {number(rms, 3)}.")
    return " ".join(sentences)
