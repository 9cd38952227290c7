"""``gonio report``: tables, fits, checks and pictures in one self-contained page."""

import argparse
import shlex
from pathlib import Path

from gonio.cli.arguments import FORCE, READING, Options, add_options, as_stated, beside_stated, write_json
from gonio.text import log, show

TITLE = "BRDF report"
OPTIONS: Options = {
    "-o/--output OUT.html": {"required": True, "help": "the page; all values go to OUT.json beside it"},
    "--fit FIT.toml": {
        "action": "append",
        "default": [],
        "help": "a fitted material, for the table or profile that it names; several are shown side by side",
    },
    "--against FILE|MATERIAL": "the truth, if known: agreement with it is judged too",
    "--chart FOLDER": "charts that back the settings: what 'gonio chart -o' wrote",
    "--figures FOLDER": "write every figure as SVG and PNG too",
    "--render": "show a sphere of each that Mitsuba renders, where it is installed",
    "--no-check": "leave the checks out",
    "--title TITLE": {"default": TITLE, "help": "the page's heading"},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    subjects = (
        "tables, profiles or materials: files, names or expressions; fitted materials of one among them are shown with "
    )
    subjects += "it, side by side"
    parser.add_argument("subjects", nargs="+", metavar="FILE", help=subjects)
    add_options(parser.add_argument, OPTIONS | READING | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.figures.drawing_process import drawing_beside

    with drawing_beside():  # begun before the imports, which take as long as its own
        return _report(args)


def _report(args: argparse.Namespace) -> int:
    from gonio.reports.build import report

    options = {name: getattr(args, name) for name in ("against", "chart", "figures", "render", "title", "force")}
    options |= {"command": _command(args), "log": log}
    subjects = [beside_stated(s, args) for s in args.subjects]
    if all(isinstance(s, str) for s in subjects):  # no file takes what is stated, if anything is
        subjects = [as_stated(s, args) for s in args.subjects]
    report(subjects, args.output, fits=args.fit, check=not args.no_check, **options)
    values = Path(args.output).with_suffix(".json")
    show(f"written: {args.output} and {values.name}")
    return write_json(args, {"written": args.output, "values": str(values)})


def _command(args: argparse.Namespace) -> str:
    words = ["gonio", "report", *args.subjects, *(word for fit in args.fit for word in ("--fit", fit))]
    for name in ("against", "chart", "figures", "angles", "quantity", "missing", "mirror_azimuth", "coverage", "scale"):
        value = getattr(args, name)
        words += [] if value is None else [f"--{name.replace('_', '-')}", str(value)]
    words += (
        ["--render"] * args.render
        + ["--no-check"] * args.no_check
        + (["--title", args.title] if args.title != TITLE else [])
    )
    return shlex.join([*words, "-o", args.output])
