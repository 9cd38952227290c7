"""What the comments of a CSV file state: units, quantity, the missing value, channels, wavelengths and layout."""

import contextlib
import json
import re
from collections.abc import Sequence
from typing import Any

from gonio.data import layouts
from gonio.data.formats.csv.header import LENGTHS_NM, NUMBER
from gonio.data.layouts import Layout
from gonio.models.errors import GonioError

LONGEST_COMMENT = 2000
"""Characters of a comment in free text that are looked at."""
NOT_SO = re.compile(r"(?i)\b(?:not|no|without|divided|converted|from|free of|w/o|removed|excluding)\b")
"""Words by which a mention of a quantity may say the opposite."""
MENTIONS = {
    "reflectance_factor": re.compile(r"(?i)reflectance[ _-]factors?\b|\bBRF\b|\bquantity\b.*\breflectance_factor\b"),
    "i_over_f": re.compile(r"\bI/F\b|\bRADF\b|(?i:\bquantity\b.*\bi_over_f\b)"),
    "brdf_cos_i": re.compile(
        r"(?i)\b(?:brdf|f_?r?)\s*[*·×]?\s*(?:times)?\s*cos\w*[\s(_]*(?:theta|θ)_?i|\bbrdf_cos_i\b"
    ),
    "brdf_cos": re.compile(
        r"(?i)\b(?:brdf|f_?r?)\s*[*·×]?\s*(?:times|including|with|incl\.)?\s*(?:the\s+)?cos(?!\w*[\s(_]*(?:theta|θ)_?i)"
        r"|\bcosine[- ]corrected|\bccbrdf\b|\bbrdf_cos\b(?!_i)|(?:with|including|incl\.?)\s+(?:the\s+)?cosine"
    ),
}
"""How free text mentions a quantity other than the BRDF."""


class Statements:
    """The comments of a file, asked for one thing after another."""

    def __init__(self, path: str, comments: Sequence[str]) -> None:
        self.path = path
        self.comments = comments
        self.by_gonio = any(c.startswith("gonio:") for c in comments)
        """Whether gonio wrote the file."""

    def json(self, key: str) -> Any:
        """The JSON value of the comment ``key: value``; None where there is none."""
        for comment in self.comments:
            name, _, value = comment.partition(":")
            if name == key:
                with contextlib.suppress(ValueError, RecursionError):  # ValueError: no JSON, or too many digits
                    return json.loads(value)
        return None

    def angle_unit(self, stated: bool = False) -> str | None:
        """Degrees or radians, where a comment on angles names one.

        Raises GonioError where comments name both, unless the unit is `stated` elsewhere.
        """
        units = set()
        for text in self._free():
            if re.search(r"(?i)angle|theta|phi|θ|φ|polar|azimuth|zenith", text):
                units |= {"radians"} if re.search(r"(?i)\brad(?:ians?|s)?\b", text) else set()
                units |= {"degrees"} if re.search(r"(?i)\bdeg(?:rees?|s)?\b|°", text) else set()
        if len(units) > 1 and stated:
            return None
        if len(units) > 1:
            raise GonioError(
                f"{self.path} mentions degrees and radians in its comments; state --angles degrees or radians"
            )
        return next(iter(units), None)

    def quantity(self) -> str | None:
        """The stored quantity that a comment names. Raises GonioError where that cannot be known."""
        named = {key: text for key, mention in MENTIONS.items() for text in self._free() if mention.search(text)}
        if len(named) > 1 or any(NOT_SO.search(text) for text in named.values()):
            remark = next(iter(named.values()))[:80]
            raise GonioError(
                f"{self.path} says '{remark}', by which its values may or may not be {' or '.join(named)}; "
                "state --quantity brdf or another"
            )
        return next(iter(named), None)

    def missing_value(self) -> float | None:
        """The number that stands for no reading, where a comment says so."""
        words = r"(?:missing|no[ _-]?data|fill|invalid)[ _-]?(?:values?|cells?|data)?"
        for text in self._free():
            if match := re.search(rf"(?i)\b{words}\s*(?:[:=]|is|are|as|written as)\s*(-?{NUMBER})", text):
                return float(match[1])
        return None

    def coverage_factor(self) -> float:
        """k of expanded uncertainties, by a comment that has ``k = 2``; else 1."""
        matches = (re.search(r"\bk\s*=\s*(\d(?:\.\d{1,3})?)\b", text) for text in self._free())
        return next((float(match[1]) for match in matches if match and float(match[1]) >= 1), 1.0)

    def wavelengths_nm(self) -> list[float] | None:
        """Wavelengths in a list of their own, by gonio's key or in free text with a unit."""
        values = self.json("wavelengths_nm")
        if isinstance(values, list) and values and all(isinstance(v, int | float) for v in values):
            with contextlib.suppress(OverflowError):
                return [float(v) for v in values]
        for text in self._free():
            if match := re.match(r"(?i)(?:wavelengths?|lambda|λ)\b\s*(.*)", text):
                units = [u for u in re.findall(r"[a-zµμ]+", match[1].lower()) if u in LENGTHS_NM]
                numbers = [float(n) for n in re.findall(rf"(?<![\w.])({NUMBER})(?=\s|[,;\]a-zµμ]|$)", match[1].lower())]
                if numbers and len(set(units)) == 1:
                    return [round(n * LENGTHS_NM[units[0]], 6) for n in numbers]
        return None

    def layout(self) -> Layout | None:
        """The layout whose cells above the horizon the rows are, in gonio's own files."""
        stated = self.json("layout")
        if not isinstance(stated, dict) or not isinstance(stated.get("axes"), dict):
            return None
        kind = layouts.LAYOUTS.get(str(stated.get("name")))
        if kind is None or not kind.gridded:
            return None
        with contextlib.suppress(GonioError):
            return kind(stated["axes"])
        return None

    @property
    def scattered(self) -> bool:
        """Whether gonio wrote the file of a table without a grid."""
        stated = self.json("layout")
        return isinstance(stated, dict) and stated.get("name") == "scattered"

    def _free(self) -> list[str]:
        return [
            c[:LONGEST_COMMENT] for c in self.comments[:500] if not c.startswith(("gonio:", "channels:", "layout:"))
        ]
