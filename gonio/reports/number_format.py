"""Values of the document as texts: each carries its place in the document, a JSON pointer [RFC 6901]."""

import math
from typing import Any

from markupsafe import Markup, escape

from gonio.text import power_of_ten


def written(value: float, digits: int = 6) -> str:
    """A number at so many significant digits, with a power of ten where it is very small or large."""
    if value == 0:
        return "0"
    text = f"{value:.{digits - 1}e}"
    mantissa, exponent = text.split("e")
    power = int(exponent)
    if -5 < power < digits:
        return f"{float(text):.{digits - 1 - power}f}".replace("-", "−")
    if -5 < power < 6:
        return f"{value:.0f}".replace("-", "−")
    return f"{_without_zeros(mantissa)}×{power_of_ten(power)}".replace("-", "−", 1)


def _without_zeros(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text and "×" not in text else text


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
            text = _without_zeros(text)
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
