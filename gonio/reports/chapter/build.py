"""`chapter`: all experiments, and the page that shows them."""

import base64
import importlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gonio.data.files import new_file, refuse_outputs
from gonio.models.errors import GonioError
from gonio.reports.chapter.experiment import Experiment
from gonio.reports.chapter.numbers import Numbers, numbers_of
from gonio.text import versions

FIGURES = {
    "light:patch": "12.1", "light:detector": "12.2", "light:two_apertures": "12.3", "surface:differentials": "12.4",
    "surface:reciprocity": "12.4", "surface:energy": "12.5", "surface:hours": "12.6", "surface:wavelengths": "12.6",
    "beyond:through": "12.6", "beyond:below": "12.6", "beyond:waves": "12.6",
}  # fmt: skip
"""The experiments in the chapter's order, each a function of the numbers, with its figure there.

The numbers follow the order of the subjects; whoever has the book before him corrects them here."""


def chapter(
    output: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    log: Callable[[str], None] = lambda line: None,
    **changes: Any,
) -> Path | str:
    """Computes the textbook's ideas as small experiments, and writes them on one page.

    Args:
        output: the page, ending in .html; None returns its text.
        force: replaces an existing page.
        log: called with a line for each experiment as it begins, and each of its results.
        changes: numbers of the experiments by their names (see `gonio.reports.chapter.numbers`), angles in degrees.

    Returns:
        The path of the page, or its text.

    Raises:
        GonioError: for a number that there is not or that leaves its domain, a material that cannot be read, and an
            output that exists or is no page.
    """
    numbers = numbers_of(changes)
    if output is not None:
        refuse_outputs([Path(output)], [], force)
        if Path(output).suffix.lower() not in (".html", ".htm"):
            raise GonioError(f"{output} is no name of a page; end it in .html")
    began = time.perf_counter()
    experiments = []
    for k, name in enumerate(FIGURES):
        e = _run(name, numbers)
        experiments.append(e)
        log(f"{k + 1}. {e.title}")
        for r in e.results:
            value, error, expected = r.texts
            beside = f"; expected {expected}: {r.verdict}" if r.verdict else ""
            log(f"   {r.name}: {value} ± {error} {r.unit if r.unit != '1' else ''}".rstrip() + beside)
    text = _page(experiments, numbers, time.perf_counter() - began)
    if output is None:
        return text
    with new_file(Path(output), force) as file:
        file.write_bytes(text.encode(errors="backslashreplace"))
    return Path(output)


def _run(name: str, numbers: Numbers) -> Experiment:
    module, function = name.split(":")
    return getattr(importlib.import_module(f"gonio.reports.chapter.{module}"), function)(numbers)


def _page(experiments: list[Experiment], numbers: Numbers, seconds: float) -> str:
    import jinja2

    from gonio.figures.style import PALETTE
    from gonio.reports.page import rules, themed

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("gonio.reports"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    pictures, used = [], set(PALETTE)
    for e in experiments:
        text, needed = themed(e.picture.svg(), set(PALETTE))
        pictures.append(text)
        used |= needed
    return environment.get_template("chapter.html.j2").render(
        experiments=experiments,
        figures=list(FIGURES.values()),
        pictures=pictures,
        images=[base64.b64encode(e.image).decode() if e.image else "" for e in experiments],
        numbers=numbers.rows,
        seconds=seconds,
        versions=versions("jax"),
        dark=rules(used),
    )
