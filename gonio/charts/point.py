"""Charts and their points, with a cost and an error each; the Pareto front; the hours of a real instrument."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from gonio.data.layouts import Layout
from gonio.models.errors import GonioError


@dataclasses.dataclass(frozen=True)
class Pace:
    """The pace of an instrument: all axes move at once, the slowest sets the time; then it settles, then it counts.

    Between two readings: max over the four angles of |change| / `axis_speed`, plus `settling`; azimuths take the
    shorter way round. Counting takes photons / `count_rate`, photons being those expected of the white diffuser at
    normal incidence. Readings are taken row by row, every other row backwards; what is below the horizon is left out.
    Raises GonioError for what is not above 0 (`settling`: below 0).
    """

    axis_speed: float = math.radians(10.0)
    """Radians a second."""
    settling: float = 0.3
    """Seconds from arrival to reading."""
    count_rate: float = 1e6
    """Counts a second of the perfect white diffuser at normal incidence."""

    def __post_init__(self) -> None:
        for name in ("axis_speed", "settling", "count_rate"):
            value = getattr(self, name)
            if not (math.isfinite(value) and (value > 0 or (value == 0 and name == "settling"))):
                raise GonioError(f"{name.replace('_', ' ')} is {value:g}; give a number above 0")

    def seconds(self, layout: Layout, photons: float) -> float:
        """Seconds of a whole scan, at so many photons a reading."""
        order = _there_and_back(layout.shape)
        order = order[layout.above_horizon()[order]]
        if not order.size:
            return 0.0
        angles = [np.asarray(a)[order] for a in layout.angles()]
        steps = [np.abs(np.diff(a)) for a in angles]
        steps = [np.minimum(s, 2 * np.pi - s) if k % 2 else s for k, s in enumerate(steps)]
        moving = float(np.sum(np.max(steps, axis=0))) / self.axis_speed
        return moving + order.size * (self.settling + photons / self.count_rate)

    def sentence(self) -> str:
        """The model, for a caption."""
        return (
            f"Hours of an instrument whose arms turn by {math.degrees(self.axis_speed):g}°/s, settle in "
            f"{self.settling:g} s and count {self.count_rate:g} photons/s off the white diffuser."
        )


def _there_and_back(shape: tuple[int, ...]) -> np.ndarray:
    # C-order numbers of the cells, every other row of each axis backwards, so that no arm ever flies back.
    index = np.indices(shape).reshape(len(shape), -1)
    turned = [index[0]]
    for k in range(1, len(shape)):
        row = np.ravel_multi_index(tuple(index[:k]), shape[:k])
        turned.append(np.where(row % 2, shape[k] - 1 - index[k], index[k]))
    return np.asarray(np.ravel_multi_index(tuple(turned), shape))


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

    def clock(self, rounds: int = 7) -> tuple[int, float]:
        """Rounds of timing, and seconds for each call of them: three and 0.1 s for a quick chart."""
        return (3, 0.1) if self.quick else (rounds, 0.5)


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
