"""`chart`: speed against accuracy, measured here and now; points, pictures, and the cheapest method that is enough."""

import datetime
import math
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from gonio.charts import albedos, evaluation, fits, scans, tables
from gonio.charts.folder import ChartFolder
from gonio.charts.machine import machine
from gonio.charts.point import Chart, Settings
from gonio.charts.result import MeasuredChart
from gonio.charts.scan_time import Pace
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
