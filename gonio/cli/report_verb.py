"""``gonio report``: tables, fits, checks and pictures in one self-contained page."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("subjects", nargs="+", metavar="FILE", help="tables or materials: files, names or expressions")
    parser.add_argument(
        "-o", "--output", required=True, metavar="OUT.html", help="the page; all values go to OUT.json beside it"
    )
    parser.add_argument(
        "--fit", action="append", default=[], metavar="FIT.toml", help="a fitted material, for the table that it names"
    )
    parser.add_argument(
        "--against", metavar="FILE|MATERIAL", help="the truth, if known: agreement with it is judged too"
    )
    parser.add_argument("--chart", metavar="FOLDER", help="charts that back the settings: what 'gonio chart -o' wrote")
    parser.add_argument("--figures", metavar="FOLDER", help="write every figure as SVG and PNG too")
    parser.add_argument("--no-check", action="store_true", help="leave the checks out")
    parser.add_argument("--title", default="BRDF report", help="the page's heading")
    parser.add_argument("--force", action="store_true", help="replace existing outputs")


def run(args: argparse.Namespace) -> int:
    from gonio.reports.build import report
    from gonio.text import say

    path = report(
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
    say(f"written: {path} and {path.with_suffix('.json').name}")
    return 0


def _command(args: argparse.Namespace) -> str:
    import shlex

    words = ["gonio", "report", *args.subjects, *(w for f in args.fit for w in ("--fit", f))]
    for option in ("against", "chart", "figures"):
        value = getattr(args, option)
        words += [f"--{option}", value] if value else []
    words += ["--no-check"] if args.no_check else []
    words += ["--title", args.title] if args.title != "BRDF report" else []
    return shlex.join([*words, "-o", args.output])
