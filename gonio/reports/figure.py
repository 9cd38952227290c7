"""A figure of a report: the picture, its caption, and the numbers that it shows."""

import dataclasses
from typing import Any

import numpy as np

from gonio.figures.style import Picture


@dataclasses.dataclass
class ReportFigure:
    """A picture with its caption; `data` holds the numbers that it shows, as JSON can hold them."""

    slug: str
    caption: str
    picture: Picture
    data: dict[str, Any]
    kind: str = "panel"
    """panel, small (some in a row), bar (a colour scale below them) or space (a lobe to be turned)."""
    id: str = ""


def rounded(values: Any, digits: int = 6) -> Any:
    """Nested lists of numbers at so many significant digits; None where there is no finite one."""
    if isinstance(values, np.ndarray | list | tuple):
        return [rounded(v, digits) for v in values]
    value = float(values)
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None
