"""``gonio chart``: speed against accuracy, measured here and now."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="evaluation, hemisphere, tables, fits, measuring (default: all)"
    )
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", help="where to put pictures (SVG, PNG), CSV and charts.json"
    )
    parser.add_argument("--quick", action="store_true", help="fewer settings: less than two minutes")
    parser.add_argument("--tolerance", type=float, metavar="ERROR", help="name the cheapest method within this error")
    parser.add_argument("--axis-speed", type=float, metavar="DEG/S", help="of the real instrument (default: 10)")
    parser.add_argument("--settling", type=float, metavar="S", help="of the real instrument, seconds (default: 0.3)")
    parser.add_argument(
        "--count-rate", type=float, metavar="1/S", help="photons a second off the white diffuser (default: 1e6)"
    )
    parser.add_argument("--force", action="store_true", help="replace charts in the folder")


def run(args: argparse.Namespace) -> int:
    import math

    from gonio.charts.diagrams import chart
    from gonio.charts.scan_time import Pace
    from gonio.figures.ticks import sr_label
    from gonio.text import columns, say, tell

    given = {"settling": args.settling, "count_rate": args.count_rate}
    if args.axis_speed is not None:
        given["axis_speed"] = math.radians(args.axis_speed)
    pace = Pace(**{name: value for name, value in given.items() if value is not None})
    done = chart(
        args.names,
        output=args.output,
        quick=args.quick,
        tolerance=args.tolerance,
        pace=pace,
        force=args.force,
        say=tell,
    )
    for measured in done:
        cost, error = measured.chart.frames[0]
        say(f"\n{measured.chart.title}: {error.title} against {cost.title}")
        rows = []
        for panel in measured.panels:
            if args.tolerance is None:
                rows += [_row(p, panel, cost, error) for p in measured.front(panel)]
                continue
            best = measured.cheapest(panel, args.tolerance)
            nothing = [panel, f"nothing within {sr_label(args.tolerance)}", "", "–", "–", ""]
            rows.append(_row(best, panel, cost, error) if best else nothing)
        head = "cheapest method" if args.tolerance is not None else "on the front"
        claims = any(p.holds is not None for p in measured.points)
        rows = [row[: None if claims else -1] for row in rows]
        say(columns(rows, ["", head, "setting", cost.key, error.key, *(["bound"] * claims)]))
        for p in measured.broken:
            say(f"bound does not hold: {p.panel}, {p.method} {p.setting}: {p.note}")
    if args.output:
        files = ", ".join(f"{m.chart.name}.svg" for m in done)
        say(f"\nwritten to {args.output}: {files}, each with PNG and CSV; charts.json")
    return int(any(measured.broken for measured in done))


def _row(point, panel: str, cost, error) -> list[str]:
    import math

    from gonio.charts.point import shown
    from gonio.text import number

    bound = point.value("bound")
    claimed = "claims none" if math.isnan(bound) else number(bound, 2)
    price, off = number(point.value(cost.key), 3), number(shown(point, error.key), 2)
    return [panel, point.method, point.setting, price, off, claimed]
