"""The page: the document in HTML, with its figures drawn in; nothing comes from elsewhere, nobody's name is code."""

import base64
import hashlib
import importlib.resources
import json
import math
import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from gonio.figures.diagnostics import channel_colours
from gonio.figures.style import MARK_BLACK, MARK_WHITE, PALETTE, hex_of, rgb_of, shades
from gonio.models.errors import printable
from gonio.reports.document import Document
from gonio.text import without_zeros, written

MARKS = {"pass": "✓", "fail": "✗", "undecided": "?", "not testable": "?", "not applicable": "–"}
UNKNOWN = 65535
DECADES = 8.0


def page(document: Document, values_file: str | None) -> str:
    """The HTML of a report. `values_file`: the name of the JSON beside it, which the page names."""
    import jinja2

    from gonio.reports.kept_templates import KeptTemplates

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("gonio.reports"), bytecode_cache=KeptTemplates(),
        autoescape=True, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    script = (importlib.resources.files("gonio.reports") / "templates" / "report_lobes.js").read_text(encoding="utf-8")
    pictures, used = {}, set(PALETTE)
    accents = _accents()
    for name, figure in document.figures.items():
        pictures[name], needed = themed(figure.picture.svg(), accents)
        used |= needed
    subjects = document.values["subjects"]
    lobes = {f["id"]: _lobe(f["data"]) for s in subjects for f in s["figures"] if f["kind"] == "space"}
    return environment.get_template("report.html.j2").render(
        d=document.values,
        v=Values(document.values),
        marks=MARKS,
        pictures=pictures,
        spheres=document.spheres,
        chart_pictures=[c["picture"] for c in document.charts],
        variable=variable,
        values_file=values_file,
        dark=rules(used),
        lobes=embedded(lobes),
        script=script,
        policy=policy(script),
    )


def policy(script: str) -> str:
    """The page's Content-Security-Policy: it asks nobody for anything, and runs this one script.

    Style attributes stay allowed: every line of an SVG has one.
    """
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _accents() -> set[str]:
    tones = {tone for colour in PALETTE for count in range(1, 8) for tone in shades(colour, count)}
    return {*PALETTE, *tones, *channel_colours(PALETTE[0], ("R", "G", "B"))}


def embedded(value: Any) -> str:
    """JSON inside of a script element, which no "<" in it can end, whatever a name in a stranger's file says."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _lobe(data: dict[str, Any]) -> dict[str, Any]:
    """The meshes of a lobe for the script: logarithms of f below the highest, in 16 bits; 0 is no positive value.

    The largest code stands for what is not known.
    """
    high, sources = data["highest_per_sr"], []
    for source in data["sources"]:
        names = {"i": "theta_i_deg", "t": "theta_o_deg", "p": "delta_phi_deg"}
        sets = [
            {**{k: m[name] for k, name in names.items()}, "f": _packed(m["f_per_sr"], high)}
            for m in source["incidences"]
        ]
        sources.append({"name": source["name"], "sets": sets})
    return {"high": high, "decades": DECADES, "log": data["logarithmic"], "sources": sources}


def _packed(f_per_sr: list[list[float | None]], high: float) -> str:
    f = np.array(f_per_sr, float)
    shown = np.isfinite(f) & (f > 0)
    level = 1 + (np.log10(np.where(shown, f, 1.0)) - math.log10(high)) / DECADES
    code = np.where(shown & (level > 0), np.ceil(np.clip(level, 0, 1) * (UNKNOWN - 1)), 0)
    code = np.where(np.isfinite(f), code, UNKNOWN).astype("<u2")
    return base64.b64encode(code.tobytes()).decode()


def decimals_of(uncertainty: float | None) -> int | None:
    """Decimals at which an uncertainty has two significant digits [GUM 7.2.6]; None where there is no such."""
    if uncertainty is None or not math.isfinite(uncertainty) or not 1e-9 < abs(uncertainty) < 1e5:
        return None
    return max(0, 1 - math.floor(math.log10(abs(uncertainty))))


class Values:
    """Values of the document by their place, as marked texts."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = document

    def find(self, pointer: str) -> Any:
        """The value at a JSON pointer; None where there is none."""
        value: Any = self.document
        for part in pointer.split("/")[1:]:
            key = part.replace("~1", "/").replace("~0", "~")
            try:
                value = value[int(key)] if isinstance(value, list) else value[key]
            except (KeyError, IndexError, ValueError, TypeError):
                return None
        return value

    def __call__(
        self, pointer: str, digits: int = 6, none: str = "–", beside: str | None = None, exact: bool = False
    ) -> Markup:
        """The value as a marked text.

        `beside`: the pointer to its uncertainty, which sets the number of digits. `exact`: a number that somebody
        chose, without zeros at its end.
        """
        value = self.find(pointer)
        if value is None:
            return escape(none)
        text = _text(value, digits, decimals_of(self.find(beside)) if beside else None)
        if exact:
            text = without_zeros(text)
        return Markup('<span data-at="{}">{}</span>').format(pointer, text)


def _text(value: Any, digits: int, decimals: int | None) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace("-", "−")
    if not isinstance(value, float):
        return printable(str(value), kept="\n")
    if decimals is not None and abs(value) < 1e7:
        return f"{value:.{decimals}f}".replace("-", "−")
    return written(value, digits)


DARK_PAGE = "#15181c"
LEAST = 0.52
"""Lightness of an accent on a dark page, at least."""

_TO_LMS = np.array(  # linear sRGB to Oklab [Ottosson 2020]
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def on_dark(colour: str) -> str:
    """The colour (#rrggbb) that stands for another on a dark page: greys inverted, others lightened in their order."""
    rgb = rgb_of(colour)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    lab = _TO_LAB @ np.cbrt(_TO_LMS @ linear)
    if np.ptp(rgb) < 0.02:
        page = 0.205  # lightness of the page itself, where white goes
        lab = np.array([page + (1 - lab[0]) * (0.95 - page) / (1 - 0.24), 0.0, 0.0])
    else:
        lab[0] = LEAST + (0.95 - LEAST) * np.clip((lab[0] - 0.3) / 0.5, 0, 1)
    linear = np.linalg.inv(_TO_LMS) @ (np.linalg.inv(_TO_LAB) @ lab) ** 3
    rgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.abs(linear) ** (1 / 2.4) - 0.055)
    return hex_of(np.clip(rgb, 0, 1))


def variable(colour: str) -> str:
    """The CSS value of a colour that turns light on a dark page."""
    return f"var(--c{colour[1:].lower()},{colour})"


def themed(svg: str, accents: Iterable[str]) -> tuple[str, set[str]]:
    """An SVG whose greys and accents (#rrggbb) are variables, and which of these it needs."""
    wanted = {a.lower() for a in accents}
    used: set[str] = set()

    def colour(match: re.Match) -> str:
        code = match[0].lower()
        channels = {code[1:3], code[3:5], code[5:7]}
        if code in (MARK_WHITE, MARK_BLACK) or (len(channels) > 1 and code not in wanted):
            return match[0]
        used.add(code)
        return variable(code)

    def style(match: re.Match) -> str:
        return re.sub(r"#[0-9a-fA-F]{6}\b", colour, match[0])

    return re.sub(r'(?<=\s)style="[^"]*"', style, svg), used


def rules(colours: Iterable[str]) -> str:
    """The style sheet's declarations of the variables, for a dark page."""
    return "".join(f"--c{c[1:]}:{on_dark(c)};" for c in sorted({c.lower() for c in colours}))
