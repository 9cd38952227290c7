"""Pictures on a dark page: greys and accents turn light, by variables of the page's style sheet; data colours stay."""

import re
from collections.abc import Iterable

import numpy as np
from matplotlib.colors import to_hex, to_rgb

from gonio.figures.style import MARK_BLACK, MARK_WHITE

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
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    lab = _TO_LAB @ np.cbrt(_TO_LMS @ linear)
    if np.ptp(rgb) < 0.02:
        page = 0.205  # lightness of the page itself, where white goes
        lab = np.array([page + (1 - lab[0]) * (0.95 - page) / (1 - 0.24), 0.0, 0.0])
    else:
        lab[0] = LEAST + (0.95 - LEAST) * np.clip((lab[0] - 0.3) / 0.5, 0, 1)
    linear = np.linalg.inv(_TO_LMS) @ (np.linalg.inv(_TO_LAB) @ lab) ** 3
    rgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.abs(linear) ** (1 / 2.4) - 0.055)
    red, green, blue = np.clip(rgb, 0, 1)
    return to_hex((red, green, blue))


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
