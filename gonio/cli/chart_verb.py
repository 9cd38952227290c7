"""``gonio chart``: speed against accuracy, measured here and now."""

import argparse
import math
from typing import TYPE_CHECKING

from gonio.cli.arguments import add_force
from gonio.text import columns, log, number, show

if TYPE_CHECKING:
    from gonio.charts import MeasuredChart


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", help="evaluation, hemisphere, tables, fits, measuring (default: all)")
    add("-o", "--output", metavar="FOLDER", help="where to put pictures (SVG, PNG), CSV and charts.json")
    add("--quick", action="store_true", help="fewer settings: less than two minutes")
    add("--tolerance", type=float, metavar="ERROR", help="name the cheapest method within this error")
    add("--axis-speed", type=float, metavar="DEG/S", help="of the real instrument (default: 10)")
    add("--settling", type=float, metavar="S", help="of the real instrument, seconds (default: 0.3)")
    add("--count-rate", type=float, metavar="1/S", help="photons a second off the white diffuser (default: 1e6)")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    from gonio.charts import chart
    from gonio.charts.scan_time import Pace

    speed = None if args.axis_speed is None else math.radians(args.axis_speed)
    pace = {"settling": args.settling, "count_rate": args.count_rate, "axis_speed": speed}
    measured = chart(
        args.names,
        output=args.output,
        quick=args.quick,
        tolerance=args.tolerance,
        pace=Pace(**{name: value for name, value in pace.items() if value is not None}),
        force=args.force,
        log=log,
    )
    for m in measured:
        _print_chart(m, args.tolerance)
    if args.output:
        files = ", ".join(f"{m.chart.name}.svg" for m in measured)
        show(f"\nwritten to {args.output}: {files}, each with PNG and CSV; charts.json")
    return int(any(m.broken for m in measured))


def _print_chart(measured: "MeasuredChart", tolerance: float | None) -> None:
    from gonio.charts.point import shown
    from gonio.figures.ticks import sr_label

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
