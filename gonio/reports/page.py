"""The page: the document in HTML, with its figures drawn in; nothing comes from elsewhere, nobody's name is code."""

import base64
import importlib.resources
import json
import math
from typing import Any

import numpy as np

from gonio.figures.albedo import channel_colours
from gonio.figures.dark_theme import rules, themed, variable
from gonio.figures.style import PALETTE, shades
from gonio.reports.document import Document
from gonio.reports.number_format import Values

MARKS = {"pass": "✓", "fail": "✗", "undecided": "?", "not applicable": "–"}
STEPS = 65535
DECADES = 8.0


def page(document: Document, values_file: str | None) -> str:
    """The HTML of a report. `values_file`: the name of the JSON beside it, which the page names."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("gonio.reports"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    pictures, used = {}, set(PALETTE)
    accents = _accents()
    for name, figure in document.figures.items():
        pictures[name], needed = themed(figure.picture.svg(), accents)
        used |= needed
    folder = importlib.resources.files("gonio.reports") / "templates"
    subjects = document.values["subjects"]
    lobes = {s["anchor"]: _lobe(f["data"]) for s in subjects for f in s["figures"] if f["kind"] == "space"}
    return environment.get_template("report.html.j2").render(
        d=document.values,
        v=Values(document.values),
        marks=MARKS,
        pictures=pictures,
        spheres=document.spheres,
        chart_pictures=[c["picture"] for c in document.charts],
        variable=variable,
        values_file=values_file,
        css=(folder / "report.css").read_text(encoding="utf-8"),
        dark=rules(used),
        script=(folder / "report_lobes.js").read_text(encoding="utf-8"),
        lobes=embedded(lobes),
    )


def _accents() -> set[str]:
    tones = {tone for colour in PALETTE for count in range(1, 8) for tone in shades(colour, count)}
    return {*PALETTE, *tones, *channel_colours(PALETTE[0], ("R", "G", "B"))}


def embedded(value: Any) -> str:
    """JSON inside of a script element, which no "<" in it can end, whatever a name in a stranger's file says."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _lobe(data: dict[str, Any]) -> dict[str, Any]:
    """The meshes of a lobe for the script: logarithms of f below the highest, in 16 bits; 0 is no positive value."""
    high = data["highest_per_sr"]
    sources = [
        {
            "name": source["name"],
            "sets": [
                {
                    "i": m["theta_i_deg"],
                    "t": m["theta_o_deg"],
                    "p": m["delta_phi_deg"],
                    "f": _packed(m["f_per_sr"], high),
                }
                for m in source["incidences"]
            ],
        }
        for source in data["sources"]
    ]
    return {"high": high, "decades": DECADES, "log": data["logarithmic"], "sources": sources}


def _packed(f_per_sr: list[list[float | None]], high: float) -> str:
    f = np.array(f_per_sr, float)
    shown = np.isfinite(f) & (f > 0)
    level = 1 + (np.log10(np.where(shown, f, 1.0)) - math.log10(high)) / DECADES
    code = np.where(shown & (level > 0), np.ceil(np.clip(level, 0, 1) * STEPS), 0).astype("<u2")
    return base64.b64encode(code.tobytes()).decode()
