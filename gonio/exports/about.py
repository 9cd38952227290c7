"""What a file for a renderer says of itself: where it comes from, and how far it is from that."""

import dataclasses
import json
import re
from typing import Any

from gonio.data.material import Material
from gonio.exports.reexpression import ReExpression
from gonio.models.errors import printable

LIGHT, SKY = (-0.8, -0.6, 0.6), 0.15
"""Of the scenes: direction to the sun (x to the right, y away from the eye, z up), and radiance of the sky; the sun
makes a white diffuser that faces it 1."""
SIDE, SAMPLES = 256, 64


@dataclasses.dataclass(frozen=True)
class About:
    """Name, provenance and errors of an export."""

    name: str
    """A name that every renderer takes."""
    facts: dict[str, Any]

    @property
    def lines(self) -> list[str]:
        """As comments, each without a line break, nor two hyphens (which end a comment of XML)."""
        lines = []
        for key, value in self.facts.items():
            for item in value if isinstance(value, list) else [value]:
                text = item if isinstance(item, str) else json.dumps(item)
                lines.append(re.sub(r"-(?=-)", "- ", f"{key}: {printable(text)}").rstrip("-"))
        return lines


def about(material: Material, error: ReExpression) -> About:
    """What is to be said of an export of a material."""
    from gonio import __version__

    facts: dict[str, Any] = {"written by": f"gonio {__version__}", "material": material.name}
    model = material.expression or material.description
    facts |= {"model": model} if model and model != material.name else {}
    facts |= {"source": material.source} if material.source else {}
    fit = material.meta.get("fit")
    if isinstance(fit, dict) and fit.get("table"):
        facts["fitted to"] = str(fit["table"])
    facts |= {"expressed as": f"{error.form} of {error.target}", "error of this expression": error.figures}
    facts |= {"notes": list(error.remarks)} if error.remarks else {}
    name = re.sub(r"[^A-Za-z0-9]+", "_", material.name).strip("_")[:40] or "material"
    return About(name if name[0].isalpha() else f"m_{name}", facts)


def number(value: float) -> str:
    """A number in the digits that single precision has."""
    return f"{value:.8g}"
