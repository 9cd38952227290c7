"""``gonio report``: tables, fits, checks and pictures in one self-contained page."""

import argparse
import shlex
from pathlib import Path

from gonio.cli.arguments import add_force
from gonio.text import show

TITLE = "BRDF report"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("subjects", nargs="+", metavar="FILE", help="tables or materials: files, names or expressions")
    add("-o", "--output", required=True, metavar="OUT.html", help="the page; all values go to OUT.json beside it")
    fit_help = "a fitted material, for the table that it names"
    add("--fit", action="append", default=[], metavar="FIT.toml", help=fit_help)
    add("--against", metavar="FILE|MATERIAL", help="the truth, if known: agreement with it is judged too")
    add("--chart", metavar="FOLDER", help="charts that back the settings: what 'gonio chart -o' wrote")
    add("--figures", metavar="FOLDER", help="write every figure as SVG and PNG too")
    add("--no-check", action="store_true", help="leave the checks out")
    add("--title", default=TITLE, help="the page's heading")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    from gonio.reports.build import report

    report(
        args.subjects,
        args.output,
        fits=args.fit,
        check=not args.no_check,
        against=args.against,
        chart=args.chart,
        figures=args.figures,
        title=args.title,
        command=_command(args),
        force=args.force,
    )
    show(f"written: {args.output} and {Path(args.output).with_suffix('.json').name}")
    return 0


def _command(args: argparse.Namespace) -> str:
    options = [(f"--{name}", getattr(args, name)) for name in ("against", "chart", "figures")]
    options = [("--fit", fit) for fit in args.fit] + [(name, value) for name, value in options if value]
    words = ["gonio", "report", *args.subjects, *(word for option in options for word in option)]
    words += ["--no-check"] * args.no_check + (["--title", args.title] if args.title != TITLE else [])
    return shlex.join([*words, "-o", args.output])
