"""``gonio chart``: speed against accuracy, measured here and now."""

import argparse
import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING

from gonio.cli.arguments import DESCRIPTION, FORCE, Options, add_options, given, write_json
from gonio.text import columns, log, number, show, sr_label

if TYPE_CHECKING:
    from gonio.charts import MeasuredChart

OPTIONS: Options = {
    "-o/--output FOLDER": "where to put pictures (SVG, PNG), CSV and charts.json",
    "--quick": "fewer settings: less than two minutes",
    "--tolerance ERROR": "name the cheapest method within this error",
    **DESCRIPTION,
    "--axis-speed DEG/S": "of the real instrument (default: 10)",
    "--settling S": "of the real instrument, seconds (default: 0.3)",
    "--count-rate 1/S": "photons a second off the white diffuser (default: 1e6)",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = "evaluation, hemisphere, tables, fits, measuring (default: all)"
    parser.add_argument("names", nargs="*", metavar="NAME", help=names)
    add_options(parser.add_argument, OPTIONS | FORCE, S=float)


def run(args: argparse.Namespace) -> int:
    from gonio.charts import Pace, chart
    from gonio.instrument.description import read_instrument

    options = {name: getattr(args, name) for name in ("output", "quick", "tolerance", "force")}
    described = Pace() if args.instrument is None else read_instrument(args.instrument).pace
    pace = dataclasses.replace(described, **given(args, "settling", "count_rate", "axis_speed"))
    measured = chart(args.names, pace=pace, log=log, **options)
    for m in measured:
        _print_chart(m, args.tolerance)
    if args.output:
        files = ", ".join(f"{m.chart.name}.svg" for m in measured)
        show(f"\nwritten to {args.output}: {files}, each with PNG and CSV; charts.json")
    charts = {m.chart.name: m.to_dict() | {"points": [dataclasses.asdict(p) for p in m.points]} for m in measured}
    facts = {"charts": charts, "written": args.output}
    return write_json(args, facts, int(any(m.broken for m in measured)))


def kept(args: argparse.Namespace) -> str:
    """What an interrupted call has kept."""
    folder = None if args.output is None else Path(args.output)
    if folder is None or not (folder / "charts.json").exists():
        return "nothing was written"
    return f"the charts that are finished are in {folder}: run it again to go on"


def _print_chart(measured: "MeasuredChart", tolerance: float | None) -> None:
    from gonio.charts.point import shown

    cost, error = measured.chart.frames[0]
    show(f"\n{measured.chart.title}: {error.title} against {cost.title}")
    rows: list[list[str]] = []
    for panel in measured.panels:
        points = measured.front(panel) if tolerance is None else [measured.cheapest(panel, tolerance)]
        for p in points:
            if p is None:
                rows.append([panel, f"nothing within {sr_label(tolerance or 0.0)}", "", "–", "–", ""])
                continue
            bound = p.value("bound")
            claim = "claims none" if math.isnan(bound) else number(bound, 2)
            values = number(p.value(cost.key), 3), number(shown(p, error.key), 2)
            rows.append([panel, p.method, p.setting, *values, claim])
    columns_shown = 6 if any(p.holds is not None for p in measured.points) else 5
    heading = "on the front" if tolerance is None else "cheapest method"
    headings = ["", heading, "setting", cost.key, error.key, "bound"]
    show(columns([row[:columns_shown] for row in rows], headings[:columns_shown]))
    for p in measured.broken:
        show(f"bound does not hold: {p.panel}, {p.method} {p.setting}: {p.note}")
