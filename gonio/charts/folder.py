"""A folder of charts: each chart's picture (SVG and PNG) and CSV, and charts.json, which holds all of it."""

import dataclasses
import datetime
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gonio.charts.figure import picture_files
from gonio.charts.machine import machine
from gonio.charts.point import Chart, Point, Settings
from gonio.charts.result import MeasuredChart, to_csv
from gonio.data.files import new_file
from gonio.models.errors import GonioError

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
            "pace": dataclasses.asdict(settings.pace),
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
