"""Values of the document on the page: every one carries the place (a JSON pointer, RFC 6901) where it is found."""

import math
from typing import Any

from markupsafe import Markup, escape

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def written(value: float, digits: int = 6) -> str:
    """A number at so many significant digits, with a power of ten where it is very small or large."""
    if value == 0:
        return "0"
    text = f"{value:.{digits - 1}e}"
    mantissa, exponent = text.split("e")
    power = int(exponent)
    if -5 < power < max(6, digits):
        return f"{float(text):.{max(0, digits - 1 - power)}f}".replace("-", "−") if power < digits else _whole(value)
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}×10{str(power).translate(_SUPERSCRIPT)}".replace("-", "−", 1)


def _whole(value: float) -> str:
    return f"{value:.0f}".replace("-", "−")


def decimals_of(uncertainty: float | None) -> int | None:
    """Decimals at which an uncertainty has two significant digits [GUM 7.2.6]; None where there is no such."""
    if uncertainty is None or not math.isfinite(uncertainty) or not 1e-9 < abs(uncertainty) < 1e5:
        return None
    return max(0, 1 - math.floor(math.log10(abs(uncertainty))))


class Values:
    """Looks values up in the document and writes them with their place."""

    def __init__(self, document: dict[str, Any]):
        self.document = document

    def find(self, pointer: str) -> Any:
        """What is at a JSON pointer; None where nothing is."""
        found: Any = self.document
        for part in pointer.split("/")[1:]:
            key = part.replace("~1", "/").replace("~0", "~")
            try:
                found = found[int(key)] if isinstance(found, list) else found[key]
            except (KeyError, IndexError, ValueError, TypeError):
                return None
        return found

    def __call__(
        self, pointer: str, digits: int = 6, none: str = "–", beside: str | None = None, exact: bool = False
    ) -> Markup:
        """The value as a marked text.

        `beside`: the pointer to its uncertainty, which says how many digits count. `exact`: a number that somebody
        chose, without zeros at its end.
        """
        value = self.find(pointer)
        if value is None:
            return escape(none)
        text = _text(value, digits, decimals_of(self.find(beside)) if beside else None)
        if exact and "×" not in text and "." in text:
            text = text.rstrip("0").rstrip(".")
        return Markup('<span data-at="{}">{}</span>').format(pointer, text)


def _text(value: Any, digits: int, decimals: int | None) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace("-", "−")
    if not isinstance(value, float):
        return str(value)
    if decimals is not None and abs(value) < 1e7:
        return f"{value:.{decimals}f}".replace("-", "−")
    return written(value, digits)
