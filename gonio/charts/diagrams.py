"""`chart`: speed against accuracy, measured here and now; points, pictures, and the cheapest method that is enough."""

import dataclasses
import datetime
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gonio.charts import albedos, evaluation, fits, scans, tables
from gonio.charts.figure import picture_files
from gonio.charts.point import Chart, Point, Settings
from gonio.charts.result import MeasuredChart, machine, to_csv
from gonio.data.files import new_file
from gonio.instrument.pace import Pace
from gonio.models.deprecation import old_keywords
from gonio.models.errors import GonioError, nearest

CHARTS = {module.CHART.name: module.CHART for module in (evaluation, albedos, tables, fits, scans)}


@old_keywords(say="log")
def chart(
    names: Sequence[str] | str = (),
    *,
    output: str | os.PathLike[str] | None = None,
    quick: bool = False,
    tolerance: float | None = None,
    pace: Pace | None = None,
    force: bool = False,
    log: Callable[[str], None] = lambda line: None,
) -> list[MeasuredChart]:
    """Measures charts of speed against accuracy: evaluation, hemisphere, tables, fits, measuring.

    Args:
        names: the charts; all where none is named.
        output: a folder for each chart's picture (SVG and PNG) and CSV, written as soon as it is measured, and
            charts.json. Charts that it holds, of this machine and these settings, are not measured again: a killed
            call continues, and another `tolerance` takes no time.
        quick: fewer settings, less than two minutes.
        tolerance: the cheapest method of each panel within this error is ringed.
        pace: speed of the real instrument.
        force: measures again what the folder holds.
        log: called with a line for each chart.

    Raises:
        GonioError: a name is unknown, the tolerance is not above 0, or, without `force`, the folder holds such a chart
            of other settings or another machine.
    """
    wanted = tuple(dict.fromkeys((names,) if isinstance(names, str) else names or CHARTS))
    for name in wanted:
        if name not in CHARTS:
            raise GonioError(f"Unknown chart '{name}'; {nearest(name, CHARTS)}")
    if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0):
        raise GonioError(f"the tolerance is {tolerance:g}; give an error above 0, such as 1e-3")
    settings = Settings(quick, pace or Pace())
    folder = None if output is None else ChartFolder(Path(output), settings, wanted, force)
    charts = []
    for name in wanted:
        measured = folder.measured(CHARTS[name]) if folder else None
        if measured is None:
            measured = _measure(CHARTS[name], settings)
            log(f"{name}: {len(measured.points)} points in {measured.seconds:.0f} s. {measured.bounds_line()}".rstrip())
        else:
            log(f"{name}: {len(measured.points)} points were there already; --force measures anew")
        if folder:
            folder.write(measured, tolerance)
        charts.append(measured)
    return charts


def _measure(kind: Chart, settings: Settings) -> MeasuredChart:
    began = time.perf_counter()
    points = tuple(kind.points(settings))
    now = datetime.datetime.now(datetime.UTC)
    return MeasuredChart(kind, points, machine(), now, time.perf_counter() - began, settings.quick, settings.pace)


INDEX = "charts.json"


class ChartFolder:
    """The charts of a folder, and the settings and the machine that new ones are made with.

    Raises:
        GonioError: the folder cannot be made, its index cannot be read, or, without `force`, it holds one of the
            wanted charts of other settings or another machine.
    """

    def __init__(self, folder: Path, settings: Settings, wanted: Sequence[str], force: bool):
        self.folder, self.settings = folder, settings
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise GonioError(f"{folder} cannot be a folder ({error.strerror}); name another with -o") from None
        self.recipe: dict[str, Any] = {
            "quick": settings.quick,
            "pace": json.loads(
                json.dumps(dataclasses.asdict(settings.pace))
            ),  # of tuples lists, as they are read again
            "machine": machine(),
        }
        self.charts = {name: c for name, c in self._read().items() if not (force and name in wanted)}
        for name in wanted:
            if name in self.charts and self.charts[name]["recipe"] != self.recipe:
                raise GonioError(
                    f"{folder} holds the chart {name} of other settings or another machine; name another folder, or "
                    "--force to replace it"
                )

    def _read(self) -> dict[str, dict[str, Any]]:
        path = self.folder / INDEX
        if not path.exists():
            return {}
        try:
            charts = json.loads(path.read_text(encoding="utf-8"))["charts"]
            return {name: c for name, c in charts.items() if {"recipe", "points", "made"} <= c.keys()}
        except (ValueError, KeyError, AttributeError, TypeError, OSError):
            raise GonioError(f"{path} is no list of charts; move it away, or name another folder") from None

    def measured(self, chart: Chart) -> MeasuredChart | None:
        """A chart that the folder holds already."""
        stored = self.charts.get(chart.name)
        if stored is None:
            return None
        points = tuple(Point.from_dict(p) for p in stored["points"])
        made = datetime.datetime.fromisoformat(stored["made"])
        quick, pace = self.settings.quick, self.settings.pace
        return MeasuredChart(chart, points, self.recipe["machine"], made, stored["seconds"], quick, pace)

    def write(self, measured: MeasuredChart, tolerance: float | None) -> None:
        """Writes the points of a chart, then its picture."""
        name = measured.chart.name
        self.charts[name] = measured.to_dict() | {"recipe": self.recipe}
        index = json.dumps({"gonio_charts": 1, "charts": self.charts}, indent=1)
        # What took minutes goes before what takes seconds: a picture can be made again from the points.
        self._write({f"{name}.csv": to_csv([measured]).encode(), INDEX: index.encode()})
        files = picture_files(measured.chart, measured.points, measured.caption(), tolerance)
        self._write({f"{name}.{kind}": data for kind, data in files.items()})

    def _write(self, files: Mapping[str, bytes]) -> None:
        for file, data in files.items():
            with new_file(self.folder / file, force=True) as path:
                path.write_bytes(data)
