"""``gonio demo``: measure, keep, fit, check and report bundled materials, by the commands that a user would type."""

import argparse
import os
import shlex
import sys
from typing import NamedTuple


class Sample(NamedTuple):
    """A material of the demonstration, and the models that are tried on what was read of it."""

    material: str
    models: tuple[str, ...]
    per_channel: bool = False


SAMPLES = (
    Sample("paper", ("lambert", "eon + ggx(eta=1.5)")),
    Sample("titanium_blasted", tuple(f"1 * {n}(eta=?, k=?, smith=separable)" for n in ("ggx", "beckmann")), True),
    Sample("two_lobe_paint", ("lambert + ggx(eta=1.5)", "lambert + ggx(eta=1.5) + ggx(eta=1.5)")),
)
INSTRUMENT = "--source-half-angle 0.1 --detector-half-angle 0.25 --photons 1e7 --ambient 0.02 --dark 100 --noise 0.002"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", default="demo", metavar="FOLDER", help="where to put the files (default: demo)"
    )


def run(args: argparse.Namespace) -> int:
    import time

    from gonio.models.errors import GonioError
    from gonio.text import say

    folder = args.output
    try:
        os.makedirs(folder, exist_ok=True)
    except FileExistsError:
        raise GonioError(f"{folder} is a file; name a folder for the demonstration, with -o") from None
    began = time.perf_counter()
    page = os.path.join(folder, "report.html")
    tables, fits = [], []
    for s in SAMPLES:
        table, fitted = (os.path.join(folder, f"{s.material}.{end}") for end in ("h5", "fit.toml"))
        tables.append(table)
        fits += ["--fit", fitted]
        say(f"\n── {s.material} ──")
        scan = "--scan isotropic --step 5 --seed 1"
        _do(f"measure {s.material} {scan} {INSTRUMENT} -o {shlex.quote(table)} --force")
        models = " ".join(f"-m {shlex.quote(m)}" for m in s.models) + " --per-channel" * s.per_channel
        _do(f"fit {shlex.quote(table)} {models} -o {shlex.quote(fitted)} --force")
        _do(f"check {shlex.quote(table)}")
        _do(f"check {shlex.quote(fitted)}")
    say("\n── the report ──")
    _do(f"report {shlex.join(tables + fits)} -o {shlex.quote(page)} --force")
    say(f"\nDone in {time.perf_counter() - began:.0f} s. Open this page in a browser: {os.path.abspath(page)}")
    return 0


def _do(command: str) -> None:
    """Run a command line as a user would; a verdict (exit 1 or 3) is a result here, bad input is not."""
    from gonio.__main__ import main
    from gonio.models.errors import GonioError
    from gonio.text import say

    say(f"$ gonio {command}")
    before, sys.argv = sys.argv, ["gonio", *shlex.split(command)]
    try:
        status = main()
    finally:
        sys.argv = before
    if status == 2:
        raise GonioError("the demonstration stopped at the command above")
