"""``gonio demo``: measure, keep, fit, check and report bundled materials, by the commands that a user would type.

``gonio demo chapter``: the textbook's ideas as small experiments, on one page.
"""

import argparse
import os
import shlex
import sys
import time
from typing import NamedTuple

from gonio.cli.arguments import FORCE, Options, add_options
from gonio.models.errors import GonioError
from gonio.text import show


class Sample(NamedTuple):
    """A material of the demonstration, and the models that are fitted to its readings."""

    material: str
    models: tuple[str, ...]
    per_channel: bool = False


SAMPLES = (
    Sample("paper", ("lambert", "eon + ggx(eta=1.5)")),
    Sample("titanium_blasted", tuple(f"1 * {n}(eta=?, k=?, smith=separable)" for n in ("ggx", "beckmann")), True),
    Sample("two_lobe_paint", ("lambert + ggx(eta=1.5)", "lambert + ggx(eta=1.5) + ggx(eta=1.5)")),
)
OPTIONS: Options = {
    "-o/--output OUT": "the folder of the files (demo), or the chapter's page (chapter.html)",
    "--set NAME=VALUE": {"action": "append", "default": [], "help": "a number of the chapter; the page names them all"},
    "--numbers FILE.toml": "several of them: gonio_chapter = 1, then name = value",
}
SCAN = "--scan isotropic --step 5 --seed 1"
INSTRUMENT = "--source-half-angle 0.1 --detector-half-angle 0.25 --photons 1e7 --ambient 0.02 --dark 100 --noise 0.002"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "The whole job on bundled materials, ending in a report to look at; or, as 'gonio demo chapter', the ideas of"
        " the textbook's chapter as small computed experiments on one page."
    )
    parser.add_argument("part", nargs="?", choices=("chapter",), help="the chapter's ideas as experiments")
    add_options(parser.add_argument, OPTIONS | FORCE)


def run(args: argparse.Namespace) -> int:
    if args.part == "chapter":
        return _run_chapter(args)
    if args.set or args.numbers:
        raise GonioError("--set and --numbers change numbers of the chapter: gonio demo chapter --set theta_i=60")
    args.output = args.output or "demo"
    try:
        os.makedirs(args.output, exist_ok=True)
    except FileExistsError:
        raise GonioError(f"{args.output} is a file; name a folder for the demonstration, with -o") from None
    began = time.perf_counter()
    page = os.path.join(args.output, "report.html")
    tables: list[str] = []
    fits: list[str] = []
    for s in SAMPLES:
        table, fit = (os.path.join(args.output, f"{s.material}.{end}") for end in ("h5", "fit.toml"))
        tables.append(table)
        fits += ["--fit", fit]
        show(f"\n── {s.material} ──")
        _run_command(f"measure {s.material} {SCAN} {INSTRUMENT} -o {shlex.quote(table)} --force")
        models = " ".join(f"-m {shlex.quote(m)}" for m in s.models) + " --per-channel" * s.per_channel
        _run_command(f"fit {shlex.quote(table)} {models} -o {shlex.quote(fit)} --force")
        _run_command(f"check {shlex.quote(table)}")
        _run_command(f"check {shlex.quote(fit)}")
    show("\n── the report ──")
    _run_command(f"report {shlex.join(tables + fits)} -o {shlex.quote(page)} --force")
    show(f"\nDone in {time.perf_counter() - began:.0f} s. Open this page in a browser: {os.path.abspath(page)}")
    return 0


def _run_chapter(args: argparse.Namespace) -> int:
    from gonio.reports.chapter import chapter
    from gonio.reports.chapter.numbers import assigned, read_numbers

    changes = ({} if args.numbers is None else read_numbers(args.numbers)) | assigned(args.set)
    began, page = time.perf_counter(), args.output or "chapter.html"
    chapter(page, force=args.force, log=show, **changes)
    seconds = time.perf_counter() - began
    show(f"\nDone in {seconds:.0f} s. Open this page in a browser: {os.path.abspath(page)}")
    return 0


def kept(args: argparse.Namespace) -> str:
    """What an interrupted demonstration has kept."""
    if args.part or not os.path.isdir(args.output or "demo"):
        return "nothing was written"
    return f"the files so far are in {args.output or 'demo'}; run it again from the beginning"


def _run_command(command: str) -> None:
    """Runs a command line as a user would; a verdict (exit 1 or 3) is a result here, bad input is not."""
    from gonio.cli.program import run_words

    show(f"$ gonio {command}")
    before, sys.argv = sys.argv, ["gonio", *shlex.split(command)]
    try:
        run_words(sys.argv[1:])
    finally:
        sys.argv = before
