"""``gonio campaign``: many subjects measured, fitted, checked, reduced and reported, as a recipe lists them."""

import argparse
import re
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gonio.cli.arguments import Options, add_options, hours, write_json
from gonio.models.errors import GonioError
from gonio.text import is_verbose, log, show

if TYPE_CHECKING:
    from gonio.campaigns.campaign import Campaign, CampaignOptions
    from gonio.campaigns.estimate import Estimate
    from gonio.campaigns.store import Record
    from gonio.campaigns.tasks import Task

OPTIONS: Options = {
    "-o/--output FOLDER": "where results, catalogue and page go; what is there already is kept",
    "--workers N": "processes on this machine (default: one for each processor); 0: this process alone, without Dask",
    "--scheduler ADDRESS": "the Dask scheduler whose workers do it, such as tcp://host:8786",
    "--part K/N": "the K-th of N parts alone, for an array of jobs; 'gonio campaign FOLDER' then makes the catalogue",
    "--retry": "do again what was refused",
    "--dry-run": "say how many tasks, hours on a real instrument, bytes and seconds it takes, and do nothing",
}
KINDS = {
    "part": "table parts", "measure": "tables", "fit": "fits", "check": "checks", "reduce": "reductions",
    "report": "pages",
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recipe", metavar="RECIPE.toml", help="what to do; or a campaign's folder, to make its catalogue and page anew"
    )
    add_options(parser.add_argument, OPTIONS)


def run(args: argparse.Namespace) -> int:
    if Path(args.recipe).is_dir():
        return _catalogue(args)
    if args.output is None:
        raise GonioError("name the folder of the results, as in -o runs/")
    if args.dry_run:
        return _dry_run(args)
    from gonio.campaigns.campaign import campaign

    with _progress() as over:
        options: CampaignOptions = {"workers": args.workers, "scheduler": args.scheduler, "retry": args.retry}
        options |= {"part": _part(args.part), "over": over}
        outcome = campaign(args.recipe, args.output, **options)
    _show(outcome, args.part is None)
    tally = outcome.tally
    facts: dict[str, Any] = {name: dict(getattr(tally, name)) for name in ("done", "kept", "refused", "bad", "faults")}
    facts |= {"worst": list(outcome.worst), "written": str(outcome.folder)}
    return write_json(args, {"name": outcome.name, **facts}, outcome.exit_status)


def kept(args: argparse.Namespace) -> str:
    """What an interrupted campaign has kept."""
    from gonio.campaigns.store import Store

    count = len(Store(Path(args.output or args.recipe)).keys())
    return f"{count} results are kept in {args.output}: run it again to go on" if count else "nothing was written"


def _part(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    numbers = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if numbers is None:
        raise GonioError(f"--part is {text!r}; give K/N, such as 1/100")
    return int(numbers[1]), int(numbers[2])


@contextmanager
def _progress() -> "Generator[Any]":
    """Called with each task that is over: a line each with -v, else a bar in a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    texts = ("{task.completed:.0f} of {task.total:.0f}", TimeElapsedColumn(), "left", TimeRemainingColumn())
    bar = Progress("campaign", BarColumn(), *texts, console=console, transient=True)
    number = bar.add_task("campaign", total=None)
    shown = sys.stderr.isatty() and not is_verbose()

    def over(task: "Task", record: "Record", done: int, count: int) -> None:
        if is_verbose():
            what = record.error or record.row.get("verdict") or record.status
            show(f"[{done}/{count}] {task.name}: {what}, {record.seconds:.2f} s")
        elif shown:
            bar.start()
            bar.update(number, completed=done, total=count)

    try:
        yield over
    finally:
        if bar.live.is_started:
            bar.stop()


def _show(outcome: "Campaign", whole: bool) -> None:
    """What was done, what was there already, what a user must look after."""
    tally = outcome.tally
    done, there = (_counts(c) for c in (tally.done, tally.kept))
    show(f"{outcome.name}: done {done or 'nothing'}" + (f"; there already {there}" if there else ""))
    for name, words in (("refused", "refused"), ("bad", "failed, by their verdict")):
        if count := _counts(getattr(tally, name)):
            show(f"{words}: {count}")
    if tally.faults:
        show(f"not done: {len(tally.faults)}; run it again to try them once more")
    for sentence in outcome.worst:
        show(f"  {sentence}")
    if whole:
        show(f"written: {outcome.folder}, with catalogue.parquet and index.html")
    else:
        log(f"gonio campaign {outcome.folder} makes the catalogue, when all parts are done")


def _counts(counts: dict[str, int]) -> str:
    there = ((counts[kind], name) for kind, name in KINDS.items() if counts.get(kind))
    return ", ".join(f"{count:,} {name.removesuffix('s') if count == 1 else name}" for count, name in there)


def _catalogue(args: argparse.Namespace) -> int:
    if args.output or args.part or args.scheduler or args.dry_run or args.retry or args.workers is not None:
        raise GonioError(
            f"{args.recipe} is a folder, whose catalogue is made anew; leave options out, or give a recipe"
        )
    from gonio.campaigns.campaign import catalogue
    from gonio.campaigns.store import Store

    count, not_done = catalogue(args.recipe), Store(Path(args.recipe)).not_done()
    show(f"written: {Path(args.recipe) / 'catalogue.parquet'}, {count:,} rows, and index.html")
    if not_done:
        show(f"{not_done:,} tasks of the recipe are not done; give the recipe again to go on")
    return write_json(args, {"rows": count, "not_done": not_done, "written": args.recipe})


def _dry_run(args: argparse.Namespace) -> int:
    from gonio.campaigns.campaign import dry_run

    name, takes = dry_run(args.recipe, args.output)
    show(f"{name}: {_counts(takes.tasks)}" + (f"; {takes.kept:,} tasks are done already" if takes.kept else ""))
    show(f"tables: {takes.cells:,} cells, at most {_bytes(takes.bytes)} before compression")
    show(f"on a real instrument: {hours(3600 * takes.hours)}")
    show(f"computing: about {hours(takes.seconds)} on one core, {_basis(takes)}")
    facts = {"tasks": takes.tasks, "kept": takes.kept, "cells": takes.cells, "bytes": takes.bytes, "hours": takes.hours}
    return write_json(args, {"name": name, **facts, "seconds": takes.seconds, "seconds_measured": takes.measured})


def _basis(takes: "Estimate") -> str:
    return "by the results that are there" if takes.measured else "a guess by small tables"


def _bytes(count: int) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
