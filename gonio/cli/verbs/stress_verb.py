"""``gonio stress``: where each method fails, and that it says so."""

import argparse
import dataclasses

from gonio.cli.arguments import FORCE, Options, add_options, write_json
from gonio.models.errors import GonioError
from gonio.text import columns, log, show

OPTIONS: Options = {
    "-o/--output FOLDER": "where to put the page, the pictures and stress.csv",
    "--quick": "six models that stand for all, few settings: about a minute on two cores",
    "--cell KEY": "do one cell of a model again, by the key in stress.csv",
    "--processes N": "how many at once (default: one for each processor)",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = "default: all, a quarter of an hour on two cores"
    parser.add_argument("models", nargs="*", metavar="NAME", help=names)
    add_options(parser.add_argument, OPTIONS | FORCE)


def run(args: argparse.Namespace) -> int:
    from gonio.stability.outcome import METHODS, SILENT
    from gonio.stability.survey import repeat_cell, stress

    if args.processes is not None and args.processes < 1:
        raise GonioError(f"--processes is {args.processes}; give 1 or more")
    if args.cell:
        if len(args.models) != 1:
            raise GonioError("--cell does one cell of one model again; name that model")
        cells = repeat_cell(args.models[0], args.cell, args.quick)
        for c in cells:
            show(f"{c.verdict}: {c.detail}\nerror {c.error:.3g}, allowed {c.allowed:.3g}")
        facts = [dataclasses.asdict(c) for c in cells]
        return write_json(args, {"cells": facts}, int(any(c.verdict == SILENT for c in cells)))
    options = {name: getattr(args, name) for name in ("quick", "output", "processes", "force")}
    atlas = stress(args.models, log=log, **options)
    show(columns(atlas.summary(), ["method", "cells", "right", "says so", "silently wrong"]))
    for c in atlas.silent:
        show(f"\nsilently wrong: {c.method} of {c.row} at {c.column}, {c.precision}")
        show(f"  {c.detail}\n  error {c.error:.3g}, allowed {c.allowed:.3g}; again: {c.recipe(atlas.quick)}")
    if args.output:
        show(f"\nwritten: {args.output}/index.html and stress.csv")
    show(atlas.last_line())
    counts = {method: atlas.counts(method) for method in METHODS if atlas.of_method(method)}
    silent = [dataclasses.asdict(c) | {"recipe": c.recipe(atlas.quick)} for c in atlas.silent]
    facts = {"quick": atlas.quick, "seconds": atlas.seconds, "counts": counts, "silently_wrong": silent}
    return write_json(args, facts | {"written": args.output}, atlas.exit_status)


def kept(args: argparse.Namespace) -> str:
    """What an interrupted atlas has kept."""
    return "nothing was written: an atlas is written as a whole"
