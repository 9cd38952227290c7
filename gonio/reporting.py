"""`report`: tables, fits, checks and pictures in one self-contained page."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gonio.certificate import Certificate
from gonio.data.files import new_file, refuse_existing, refuse_input
from gonio.data.material import Material, load_material
from gonio.data.table import Channels, Table
from gonio.fitting.result import FitResult
from gonio.models.base import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluate import channel_count
from gonio.report_data import Subject
from gonio.report_page import page

MOST_SUBJECTS = 50


def report(
    subjects: Sequence[Any] | Any,
    output: str | os.PathLike | None = None,
    *,
    fits: Sequence[Any] = (),
    certificates: Sequence[Certificate] | None = None,
    check: bool = True,
    title: str = "BRDF report",
    command: str | None = None,
    force: bool = False,
) -> Path | str:
    """A page about tables and models: verdicts, lobes, maps, albedo, residuals, certificates, provenance.

    `subjects`: tables, materials, models, or what names them (files, reference materials, spellings). `fits`: fit
    results, or fitted materials and their files; each goes to the table that it names, else in order. `certificates`:
    one for each subject, made here where they are not given and `check` is true. `command` is shown as the way to make
    the page again. Returns the path of the page written to `output`, or its text where `output` is None.

    Raises GonioError for what cannot be read, an existing output (unless `force`), and an output that is an input.
    """
    given = list(subjects) if isinstance(subjects, list | tuple) else [subjects]
    if not given:
        raise GonioError("A report is about at least one table or material; none was given.")
    if len(given) > MOST_SUBJECTS:
        raise GonioError(
            f"A page holds at most {MOST_SUBJECTS} subjects and {len(given)} were given; make several pages."
        )
    if output is not None:
        refuse_existing(output, force)
        refuse_input(output, *(g for g in [*given, *fits] if isinstance(g, str | os.PathLike)))
    shown = [_subject(g, number) for number, g in enumerate(given)]
    _pair(shown, [_fit(f) for f in fits])
    for k, s in enumerate(shown):
        if certificates is not None:
            s.certificate = certificates[k]
        elif check:
            from gonio.checking import check as judge

            s.certificate = judge(s.table if s.table is not None else s.material or s.brdf, name=s.name)
    text = page(shown, title, command)
    if output is None:
        return text
    with new_file(output, force) as path:
        path.write_text(text, encoding="utf-8")
    return Path(output)


def _subject(given: Any, number: int) -> Subject:
    if isinstance(given, Table):
        return Subject(given.name or "table", given.channels, table=given, number=number)
    if isinstance(given, AbstractBRDF):
        count = channel_count(given)
        channels = Channels.grey() if count is None else Channels.of_count(count)
        return Subject(type(given).__name__, channels, brdf=given, number=number)
    if isinstance(given, str | os.PathLike):
        given = load_material(given)
    if not isinstance(given, Material):
        raise GonioError(
            f"A {type(given).__name__} cannot be reported on; give a table, a material, a model or a file."
        )
    if given.spelling is None and given.meta.get("file"):
        from gonio.data.reading import read

        table = read(given.meta["file"])
        return Subject(table.name or given.name, table.channels, table=table, number=number)
    return Subject(given.name, given.channels, brdf=given.brdf, material=given, number=number)


def _fit(given: Any) -> FitResult | Material:
    if isinstance(given, FitResult):
        return given
    material = given if isinstance(given, Material) else load_material(given)
    if "fit" not in material.meta:
        raise GonioError(f"{material.name} is not a fitted material; give one that 'gonio fit' wrote.")
    return material


def _pair(shown: list[Subject], fits: list[FitResult | Material]) -> None:
    tables = [s for s in shown if s.table is not None]
    if len(fits) > len(tables):
        raise GonioError(f"{len(fits)} fits came for {len(tables)} tables; give each table at most one fit.")
    left = []
    for fit in fits:
        named = fit.table if isinstance(fit, FitResult) else fit.meta["fit"].get("table")
        mine = next((s for s in tables if s.name == named and s.fitted is None), None)
        if mine is None:
            left.append(fit)
        else:
            _give(mine, fit)
    for fit in left:
        _give(next(s for s in tables if s.fitted is None), fit)


def _give(subject: Subject, fit: FitResult | Material) -> None:
    if isinstance(fit, FitResult):
        subject.fit = fit
    else:
        subject.fit_material = fit
    count = channel_count(subject.fitted)
    if count not in (None, len(subject.channels)):
        raise GonioError(
            f"The fit has {count} channels and {subject.name} has {len(subject.channels)}; give the fit of that table."
        )
