"""A measured chart: its points, where and when they were measured, and its CSV and JSON."""

import contextlib
import csv
import dataclasses
import datetime
import io
import math
import os
import platform
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gonio.charts.point import Chart, Point, cheapest, front
from gonio.charts.timing import unit
from gonio.instrument.pace import Pace
from gonio.text import versions


@dataclasses.dataclass(frozen=True)
class MeasuredChart:
    """A chart with its points, where and when they were measured, and how many seconds that took."""

    chart: Chart
    points: tuple[Point, ...]
    machine: dict[str, str]
    made: datetime.datetime
    seconds: float
    quick: bool
    pace: Pace

    @property
    def panels(self) -> list[str]:
        """The conditions that methods are compared under."""
        return list(dict.fromkeys(p.panel for p in self.points))

    def front(self, panel: str) -> list[Point]:
        """The points of a panel that no other beats, by the axes of the first frame."""
        cost, error = self.chart.frames[0]
        return front(self._of(panel), cost.key, error.key)

    def cheapest(self, panel: str, tolerance: float) -> Point | None:
        """The cheapest point of a panel whose error is at most `tolerance`, or None."""
        cost, error = self.chart.frames[0]
        return cheapest(self._of(panel), cost.key, error.key, tolerance)

    def _of(self, panel: str) -> list[Point]:
        return [p for p in self.points if p.panel == panel]

    @property
    def broken(self) -> list[Point]:
        """The points whose claimed bound does not hold."""
        return [p for p in self.points if p.holds is False]

    def bounds_line(self) -> str:
        """How many bounds were claimed and hold; empty where none was."""
        claimed = sum(p.holds is not None for p in self.points)
        return f"{claimed - len(self.broken)} of {claimed} claimed bounds hold." if claimed else ""

    def caption(self) -> str:
        """The text below the picture: bounds, clock, machine, versions and time."""
        parts = [self.bounds_line(), self.pace.sentence() if self.chart.name == "measuring" else ""]
        if any("first_call_s" in p.values for p in self.points):
            parts.append(f"Time: median {unit()}, warm, methods in turns.")
        parts.append(sentence(self.machine, self.made) + (", quick settings." if self.quick else "."))
        return " ".join(p for p in parts if p)

    def to_dict(self) -> dict[str, Any]:
        """The chart as JSON holds it; values that are no finite number as text."""
        return {
            "title": self.chart.title,
            "about": self.chart.about,
            "caption": self.caption(),
            "frames": [[dataclasses.asdict(axis) for axis in pair] for pair in self.chart.frames],
            "made": self.made.isoformat(timespec="seconds"),
            "seconds": self.seconds,
            "points": [p.to_dict() for p in self.points],
        }


def to_csv(charts: Sequence[MeasuredChart]) -> str:
    """CSV of all points: chart, panel, method, setting, every value by its key, whether it is on the front, note."""
    keys = list(dict.fromkeys(k for c in charts for p in c.points for k in p.values))
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["chart", "panel", "method", "setting", *keys, "on_front", "bound_holds", "note"])
    for c in charts:
        best = {panel: c.front(panel) for panel in c.panels}
        for p in c.points:
            values = ["" if math.isnan(p.value(k)) else repr(p.value(k)) for k in keys]
            holds = "" if p.holds is None else int(p.holds)
            out.writerow([c.chart.name, p.panel, p.method, p.setting, *values, int(p in best[p.panel]), holds, p.note])
    return text.getvalue()


def machine() -> dict[str, str]:
    """Processor, its cores that this process may use, system and versions, by name."""
    import jax

    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    device = jax.devices()[0]
    return {
        "processor": _processor(),
        "cores": str(usable),
        "device": "the processor" if device.platform == "cpu" else device.device_kind,
        "system": f"{platform.system()} {platform.release()}",
        **versions("jax", "numpy", "scipy"),
    }


def sentence(of: dict[str, str], when: datetime.datetime) -> str:
    """The machine in a line of a caption."""
    programs = ", ".join(f"{name} {of[name]}" for name in ("gonio", "jax", "numpy", "scipy", "python"))
    on = "" if of["device"] == "the processor" else f", {of['device']}"
    return f"{of['processor']}, {of['cores']} cores{on}; {programs}; {when:%Y-%m-%d %H:%M} UTC"


def _processor() -> str:
    with contextlib.suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        if model := re.search(r"^model name.*?:(.*)", text, re.MULTILINE):
            return model[1].strip()
    return platform.processor() or platform.machine()
