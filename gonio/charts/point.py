"""Charts and their points, with a cost and an error each; the Pareto front."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from gonio.instrument.pace import Pace


@dataclasses.dataclass(frozen=True)
class Axis:
    """A quantity of the points: its key among their values, and its name with the unit."""

    key: str
    title: str


@dataclasses.dataclass(frozen=True)
class Point:
    """A method at one of its settings, measured. `panel` is the condition of the comparison, such as a lobe's width.

    `values` by key: costs and errors, `bound` (the largest error by the method's own claim; absent where it claims
    none), `known` (the uncertainty of the error itself), `first_call_s` (seconds of the first call beyond the others:
    tracing and compiling, or loading what was compiled before).
    """

    panel: str
    method: str
    setting: str
    values: dict[str, float]
    note: str = ""

    def value(self, key: str) -> float:
        """A value, NaN where there is none."""
        return self.values.get(key, math.nan)

    @property
    def holds(self) -> bool | None:
        """Whether the claimed bound holds, as far as the error is known; None where nothing is claimed."""
        if math.isnan(self.value("bound")):
            return None
        known = self.values.get("known", 0.0)
        return not self.value("error") > self.value("bound") + known

    def to_dict(self) -> dict[str, Any]:
        """The point as JSON holds it; values that are no finite number as text."""
        values = {k: v if math.isfinite(v) else str(v) for k, v in self.values.items()}
        return dataclasses.asdict(self) | {"values": values}

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> "Point":
        """The point of such a dictionary."""
        return cls(**{**stored, "values": {k: float(v) for k, v in stored["values"].items()}})


@dataclasses.dataclass(frozen=True)
class Settings:
    """How a chart is to be made."""

    quick: bool = False
    pace: Pace = dataclasses.field(default_factory=Pace)

    def clock(self) -> tuple[int, float]:
        """Rounds of timing, and seconds for each call of them: three and 0.1 s for a quick chart."""
        return (3, 0.1) if self.quick else (7, 0.5)


@dataclasses.dataclass(frozen=True)
class Chart:
    """A kind of chart: its frames, pairs of cost and error, and the function that measures its points."""

    name: str
    title: str
    about: str
    frames: tuple[tuple[Axis, Axis], ...]
    points: Callable[[Settings], Iterator[Point]]


def shown(point: Point, key: str) -> float:
    """The height of a point in a picture: an error, but no less than its uncertainty."""
    value = point.value(key)
    return max(value, point.values.get("known", 0.0)) if key == "error" else value


GAIN = 0.99
"""What costs more is on the front only if it errs less by a hundredth: less is no gain that a repetition would show."""


def front(points: Iterable[Point], cost: str, error: str) -> list[Point]:
    """The points that none beats in cost and comes within `GAIN` of in error [Pareto 1906], cheapest first."""
    usable = [p for p in points if _positive(p.value(cost)) and math.isfinite(shown(p, error))]
    kept: list[Point] = []
    for p in sorted(usable, key=lambda p: (p.value(cost), shown(p, error))):
        if not kept or shown(p, error) < GAIN * shown(kept[-1], error):
            kept.append(p)
    return kept


def cheapest(points: Sequence[Point], cost: str, error: str, tolerance: float) -> Point | None:
    """The cheapest of the points whose error is at most `tolerance`; None where there is none."""
    enough = [p for p in points if shown(p, error) <= tolerance and _positive(p.value(cost))]
    return min(enough, key=lambda p: p.value(cost), default=None)


def _positive(cost: float) -> bool:
    return math.isfinite(cost) and cost > 0
