"""``gonio demo``: measure, keep, fit, check and report bundled materials, by the commands that a user would type."""

import argparse
import os
import shlex
import sys
import time
from typing import NamedTuple

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
SCAN = "--scan isotropic --step 5 --seed 1"
INSTRUMENT = "--source-half-angle 0.1 --detector-half-angle 0.25 --photons 1e7 --ambient 0.02 --dark 100 --noise 0.002"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", default="demo", metavar="FOLDER", help="of the files (default: demo)")


def run(args: argparse.Namespace) -> int:
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


def _run_command(command: str) -> None:
    """Runs a command line as a user would; a verdict (exit 1 or 3) is a result here, bad input is not."""
    from gonio.__main__ import main

    show(f"$ gonio {command}")
    before, sys.argv = sys.argv, ["gonio", *shlex.split(command)]
    try:
        status = main()
    finally:
        sys.argv = before
    if status == 2:
        raise GonioError("the demonstration stopped at the command above")
