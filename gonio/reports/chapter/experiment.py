"""What an experiment is: an idea, results with their errors beside what the textbook expects, a picture."""

import dataclasses
import math
from collections.abc import Sequence

from gonio.figures.style import Picture

AGREES, DIFFERS = "agrees", "differs"


@dataclasses.dataclass(frozen=True)
class Result:
    """A computed number with its error (a bound, or three standard uncertainties), and what was expected of it.

    `expected` None: a number that is only reported.
    """

    name: str
    value: float
    error: float
    unit: str
    expected: float | None = None

    @property
    def verdict(self) -> str:
        """Whether value and expectation agree within the error and rounding; empty without an expectation."""
        if self.expected is None:
            return ""
        allowed = self.error + 1e-9 * max(abs(self.value), abs(self.expected))
        return AGREES if abs(self.value - self.expected) <= allowed else DIFFERS

    @property
    def texts(self) -> tuple[str, str, str]:
        """(value, error, expected) at the digits that the error leaves."""
        if not math.isfinite(self.error):
            return f"{self.value:.4g}", "no bound", "" if self.expected is None else f"{self.expected:.6g}"
        size = max(abs(self.value), self.error, 1e-300)
        digits = 12 if self.error <= 0 else math.ceil(math.log10(size / self.error)) + 2
        digits = min(max(digits, 2), 10)
        expected = "" if self.expected is None else f"{self.expected:.{digits}g}"
        return f"{self.value:.{digits}g}", f"{self.error:.1g}", expected


@dataclasses.dataclass(frozen=True)
class Experiment:
    """One idea of the chapter: a sentence or two, the law, results, a picture, and its numbers."""

    title: str
    idea: str
    law: str
    results: Sequence[Result]
    picture: Picture
    caption: str
    numbers: Sequence[str]
    image: bytes | None = None
    """A PNG shown beside the picture."""
