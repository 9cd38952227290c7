"""``gonio report``: tables, fits, checks and pictures in one self-contained page."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("subjects", nargs="+", metavar="FILE", help="tables or materials: files, names or spellings")
    parser.add_argument("-o", "--output", required=True, metavar="OUT.html", help="the page")
    parser.add_argument(
        "--fit", action="append", default=[], metavar="FIT.toml", help="a fitted material, for the table that it names"
    )
    parser.add_argument("--no-check", action="store_true", help="leave the checks out")
    parser.add_argument("--title", default="BRDF report", help="the page's heading")
    parser.add_argument("--force", action="store_true", help="replace an existing output")


def run(args: argparse.Namespace) -> int:
    import shlex

    from gonio.cli.text import say
    from gonio.reporting import report

    words = ["gonio", "report", *args.subjects, *(w for f in args.fit for w in ("--fit", f)), "-o", args.output]
    words += ["--no-check"] if args.no_check else []
    words += ["--title", args.title] if args.title != "BRDF report" else []
    path = report(
        args.subjects,
        args.output,
        fits=args.fit,
        check=not args.no_check,
        title=args.title,
        command=shlex.join(words),
        force=args.force,
    )
    say(f"written: {path}")
    return 0
