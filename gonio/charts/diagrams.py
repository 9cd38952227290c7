"""`chart`: speed against accuracy, measured here and now; points, pictures, and the cheapest method that is enough."""

import csv
import dataclasses
import datetime
import io
import json
import math
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from gonio.charts import albedos as hemisphere
from gonio.charts import evaluation, fits, tables
from gonio.charts import scans as measuring
from gonio.charts.machine import machine, sentence
from gonio.charts.point import Chart, Point, Settings, cheapest, front
from gonio.charts.scan_time import Pace
from gonio.charts.timing import unit
from gonio.data.files import new_file
from gonio.models.errors import GonioError, nearest

CHARTS = {m.CHART.name: m.CHART for m in (evaluation, hemisphere, tables, fits, measuring)}
INDEX = "charts.json"


@dataclasses.dataclass(frozen=True)
class Measured:
    """A chart with its points, where and when they were measured, and how long that took."""

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

    def front(self, panel: str, frame: int = 0) -> list[Point]:
        """The points of a panel that no other beats, by the axes of a frame."""
        cost, error = self.chart.frames[frame]
        return front(self._of(panel), cost.key, error.key)

    def cheapest(self, panel: str, tolerance: float, frame: int = 0) -> Point | None:
        """The cheapest point of a panel whose error is at most `tolerance`, or None."""
        cost, error = self.chart.frames[frame]
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
        """What stands below the picture: bounds, clock, machine, versions and time."""
        parts = [self.bounds_line(), self.pace.sentence() if self.chart.name == "measuring" else ""]
        if any("first_call_s" in p.values for p in self.points):
            parts.append(f"Time: median {unit()}, warm, methods in turns.")
        parts.append(sentence(self.machine, self.made) + (", quick settings." if self.quick else "."))
        return " ".join(p for p in parts if p)


def chart(
    names: Sequence[str] | str = (),
    *,
    output: str | os.PathLike[str] | None = None,
    quick: bool = False,
    tolerance: float | None = None,
    pace: Pace | None = None,
    force: bool = False,
    say: Callable[[str], None] = lambda line: None,
) -> list[Measured]:
    """Measures some charts (all, where none is named): evaluation, hemisphere, tables, fits, measuring.

    `output`: a folder for each chart's picture (SVG and PNG) and CSV, written as soon as it is done, and charts.json,
    which holds all of it. Charts that are there, measured on this machine with these settings, are not measured
    again: a killed call goes on, and another `tolerance` costs nothing. `tolerance`: the cheapest method of each panel
    within it is ringed. `quick`: fewer settings, less than two minutes. `pace`: how fast the real instrument is taken
    to be. `force`: measure anew. `say` hears a line for each chart. Raises GonioError for an unknown name, a tolerance
    that is not above 0, and, without `force`, a folder that holds such a chart of other settings or another machine.
    """
    asked = (names,) if isinstance(names, str) else tuple(names)
    for name in asked:
        if name not in CHARTS:
            raise GonioError(f"Unknown chart '{name}'; {nearest(name, CHARTS)}")
    if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0):
        raise GonioError(f"the tolerance is {tolerance:g}; give an error above 0, such as 1e-3")
    settings = Settings(quick, pace or Pace())
    wanted = tuple(dict.fromkeys(asked or CHARTS))
    folder = None if output is None else _Folder(Path(output), settings, wanted, force)
    done = []
    for name in wanted:
        found = folder.kept(name) if folder else None
        if found is None:
            found = _measured(CHARTS[name], settings)
            say(f"{name}: {len(found.points)} points in {found.seconds:.0f} s. {found.bounds_line()}".rstrip())
        else:
            say(f"{name}: {len(found.points)} points were there already; --force measures anew")
        if folder:
            folder.write(found, tolerance)
        done.append(found)
    return done


def _measured(kind: Chart, settings: Settings) -> Measured:
    began = time.perf_counter()
    points = tuple(kind.points(settings))
    now = datetime.datetime.now(datetime.UTC)
    return Measured(kind, points, machine(), now, time.perf_counter() - began, settings.quick, settings.pace)


class _Folder:
    """Where charts are written, and what is there already."""

    def __init__(self, folder: Path, settings: Settings, wanted: Sequence[str], force: bool):
        self.folder, self.settings = folder, settings
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise GonioError(f"{folder} cannot be a folder ({error.strerror}); name another with -o") from None
        self.recipe = {"quick": settings.quick, "pace": dataclasses.asdict(settings.pace), "machine": machine()}
        self.charts = self._held()
        if force:
            self.charts = {name: held for name, held in self.charts.items() if name not in wanted}
        other = [name for name in wanted if name in self.charts and self.charts[name]["recipe"] != self.recipe]
        if other:
            raise GonioError(
                f"{folder} holds the chart {other[0]} of other settings or another machine; name another folder, or "
                "--force to replace it"
            )

    def _held(self) -> dict[str, dict]:
        path = self.folder / INDEX
        if not path.exists():
            return {}
        try:
            held = json.loads(path.read_text(encoding="utf-8"))
            return {name: c for name, c in held["charts"].items() if {"recipe", "points", "made"} <= c.keys()}
        except (ValueError, KeyError, AttributeError, TypeError, OSError):
            raise GonioError(f"{path} is no list of charts; move it away, or name another folder") from None

    def kept(self, name: str) -> Measured | None:
        """A chart that is there."""
        held = self.charts.get(name)
        if held is None:
            return None
        points = tuple(Point(**{**p, "values": {k: float(v) for k, v in p["values"].items()}}) for p in held["points"])
        made = datetime.datetime.fromisoformat(held["made"])
        quick, pace = self.settings.quick, self.settings.pace
        return Measured(CHARTS[name], points, self.recipe["machine"], made, held["seconds"], quick, pace)

    def write(self, done: Measured, tolerance: float | None) -> None:
        """The points of a chart, then its picture."""
        from gonio.charts.figure import written

        name = done.chart.name
        self.charts[name] = to_dict(done) | {"recipe": self.recipe}
        index = json.dumps({"gonio_charts": 1, "charts": self.charts}, indent=1)
        # What took minutes goes before what takes seconds: a picture can be drawn again from the points.
        self._put({f"{name}.csv": table([done]).encode(), INDEX: index.encode()})
        drawn = written(done.chart, done.points, done.caption(), tolerance)
        self._put({f"{name}.{kind}": data for kind, data in drawn.items()})

    def _put(self, files: dict[str, bytes]) -> None:
        for file, data in files.items():
            with new_file(self.folder / file, force=True) as path:
                path.write_bytes(data)


def to_dict(done: Measured) -> dict:
    """A chart as JSON holds it; values that are no finite number as text."""
    points = [dataclasses.asdict(p) for p in done.points]
    for p in points:
        p["values"] = {k: v if math.isfinite(v) else str(v) for k, v in p["values"].items()}
    return {
        "title": done.chart.title,
        "about": done.chart.about,
        "caption": done.caption(),
        "frames": [[dataclasses.asdict(axis) for axis in pair] for pair in done.chart.frames],
        "made": done.made.isoformat(timespec="seconds"),
        "seconds": done.seconds,
        "points": points,
    }


def table(done: Sequence[Measured]) -> str:
    """CSV of all points: chart, panel, method, setting, every value by its key, whether it is on the front, note."""
    keys = list(dict.fromkeys(k for d in done for p in d.points for k in p.values))
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["chart", "panel", "method", "setting", *keys, "on_front", "bound_holds", "note"])
    for d in done:
        best = {panel: d.front(panel) for panel in d.panels}
        for p in d.points:
            values = ["" if math.isnan(p.value(k)) else repr(p.value(k)) for k in keys]
            holds = "" if p.holds is None else int(p.holds)
            out.writerow([d.chart.name, p.panel, p.method, p.setting, *values, int(p in best[p.panel]), holds, p.note])
    return text.getvalue()
