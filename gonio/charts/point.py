"""What a chart is made of: points with a cost and an error, the front that none of them beats, and the cheapest."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence

from gonio.charts.scan_time import Pace


@dataclasses.dataclass(frozen=True)
class Axis:
    """A quantity of the points: its key among their values, and its name with the unit."""

    key: str
    title: str


@dataclasses.dataclass(frozen=True)
class Point:
    """A method at one of its settings, measured. `panel`: what it is compared under, such as a width of the lobe.

    `values` by key: costs and errors, `bound` (what the method claims its error to be at most; absent where it claims
    nothing), `known` (how far the error itself is known), `first_call_s` (what the first call took beyond the others:
    tracing and compiling, or loading what was compiled before). `note`: what else is to be said.
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


@dataclasses.dataclass(frozen=True)
class Settings:
    """How a chart is to be made."""

    quick: bool = False
    pace: Pace = dataclasses.field(default_factory=Pace)

    def clock(self, rounds: int = 7) -> tuple[int, float]:
        """Rounds of timing, and seconds for each call of them: three and 0.1 s for a quick chart."""
        return (3, 0.1) if self.quick else (rounds, 0.5)


@dataclasses.dataclass(frozen=True)
class Chart:
    """A kind of chart: what stands against what (`frames`: pairs of cost and error), and what makes its points."""

    name: str
    title: str
    about: str
    frames: tuple[tuple[Axis, Axis], ...]
    points: Callable[[Settings], Iterator[Point]]


def shown(point: Point, key: str) -> float:
    """The height at which a point is drawn: an error smaller than is known of it stands where it is known to."""
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
