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
from gonio.reports.figure import Drawn
from gonio.reports.number_format import Values

MARKS = {"pass": "✓", "fail": "✗", "undecided": "?", "not applicable": "–"}
STEPS = 65535


def page(
    document: dict[str, Any],
    figures: dict[str, Drawn],
    spheres: dict[str, str],
    charts: list[dict],
    values_file: str | None,
) -> str:
    """The HTML of a report. `values_file`: the name of the JSON beside it, which the page names."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("gonio.reports"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    pictures, used = {}, set(PALETTE)
    accents = _accents()
    for name, d in figures.items():
        pictures[name], needed = themed(d.picture.svg(), accents)
        used |= needed
    folder = importlib.resources.files("gonio.reports") / "templates"
    values = Values(document)
    return environment.get_template("report.html.j2").render(
        d=document,
        v=values,
        marks=MARKS,
        pictures=pictures,
        spheres=spheres,
        chart_pictures=[c["picture"] for c in charts],
        variable=variable,
        values_file=values_file,
        css=(folder / "report.css").read_text(encoding="utf-8"),
        dark=rules(used),
        script=(folder / "report_lobes.js").read_text(encoding="utf-8"),
        lobes=embedded(
            {d["anchor"]: _lobe(f["data"]) for d in document["subjects"] for f in d["figures"] if f["kind"] == "space"}
        ),
    )


def _accents() -> set[str]:
    found = set(PALETTE)
    for colour in PALETTE:
        for count in range(1, 8):
            found |= set(shades(colour, count))
    return found | set(channel_colours(PALETTE[0], ("R", "G", "B")))


def embedded(value: Any) -> str:
    """JSON inside of a script element, which no "<" in it can end, whatever a name in a stranger's file says."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _lobe(data: dict) -> dict:
    """The meshes of a lobe for the script: logarithms of f below the highest, in 16 bits; 0 is no positive value."""
    high = math.log10(data["highest_per_sr"])
    decades = 8.0
    sources = []
    for source in data["sources"]:
        sets = []
        for one in source["incidences"]:
            f = np.array([[np.nan if v is None else v for v in row] for row in one["f_per_sr"]], float)
            shown = np.isfinite(f) & (f > 0)
            level = 1 + (np.log10(np.where(shown, f, 1.0)) - high) / decades
            code = np.where(shown & (level > 0), np.ceil(np.clip(level, 0, 1) * STEPS), 0).astype("<u2")
            sets.append(
                {"i": one["theta_i_deg"], "t": one["theta_o_deg"], "p": one["delta_phi_deg"],
                 "f": base64.b64encode(code.tobytes()).decode()}
            )  # fmt: skip
        sources.append({"name": source["name"], "sets": sets})
    return {"high": data["highest_per_sr"], "decades": decades, "log": data["logarithmic"], "sources": sources}
