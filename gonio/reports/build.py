"""`report`: tables, fits, checks and pictures in one self-contained page, and every value of it beside the page."""

import contextlib
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gonio.checks.certificate import Certificate
from gonio.data.files import new_file, output_errors, refuse_existing, refuse_input
from gonio.models.errors import GonioError
from gonio.reports.figure import Drawn
from gonio.reports.subject import Subject, fit_of, pair, subject_of, told_apart

MOST_SUBJECTS = 50
ENDINGS = (".html", ".htm")


def report(
    subjects: Sequence[Any] | Any,
    output: str | os.PathLike | None = None,
    *,
    fits: Sequence[Any] = (),
    certificates: Sequence[Certificate | None] | None = None,
    check: bool = True,
    against: Any = None,
    chart: str | os.PathLike | None = None,
    figures: str | os.PathLike | None = None,
    title: str = "BRDF report",
    command: str | None = None,
    force: bool = False,
) -> Path | str:
    """A page about tables and models: verdicts first, lobes, maps, albedo, residuals, provenance.

    `subjects`: tables, materials, models, or what names them (files, reference materials, expressions). `fits`: fit
    results, or fitted materials and their files; each goes to the table that it names. `certificates`: one for each
    subject (None: make it), made here where they are not given and `check` is true, then with agreement with `against`,
    a stated truth, if there is one. `chart`: a folder that `gonio chart` wrote, whose charts back the settings.
    `figures`: a folder for every figure as SVG and PNG. `command` is shown as the way to make the page again.

    Beside the page (OUT.html) stands OUT.json with every value on it. Returns the path of the page written to `output`,
    or its text where `output` is None. Nothing is written before all is made.

    Raises GonioError for what cannot be read, an existing output (unless `force`), and an output that is an input.
    """
    given = list(subjects) if isinstance(subjects, list | tuple) else [subjects]
    if not given:
        raise GonioError("A report is about at least one table or material; none was given.")
    if len(given) > MOST_SUBJECTS:
        raise GonioError(
            f"A page holds at most {MOST_SUBJECTS} subjects and {len(given)} were given; make several pages."
        )
    if certificates is not None and len(certificates) != len(given):
        raise GonioError(f"{len(certificates)} certificates came for {len(given)} subjects; give one each, or None.")
    index = [] if chart is None else [Path(chart) / "charts.json"]
    values = None if output is None else _outputs(output, [*given, *fits, against, *index], force)
    if figures is not None:
        _refuse_figures(Path(figures), force)
    shown = [subject_of(g, number) for number, g in enumerate(given)]
    pair(shown, [fit_of(f) for f in fits])
    told_apart(shown)
    charts = []
    if chart is not None:
        from gonio.reports.chart_folder import charts_of

        charts = charts_of(chart)
    _certify(shown, certificates, check, against)
    from gonio.reports.document import assembled
    from gonio.reports.page import page

    document, drawn, spheres = assembled(shown, title, command, charts)
    text = page(document, drawn, spheres, charts, None if values is None else values.name)
    files = {} if figures is None else _figure_files(drawn, shown)
    with contextlib.ExitStack() as stack:
        if output is not None:
            stack.enter_context(new_file(output, force)).write_text(text, encoding="utf-8")
            held = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
            stack.enter_context(new_file(values, force)).write_text(held, encoding="utf-8")
        if files:
            _write(Path(figures), files)
    return text if output is None else Path(output)


def _outputs(output: str | os.PathLike, inputs: Sequence[Any], force: bool) -> Path:
    """The file of values beside the page, both of them free to be written."""
    path = Path(output)
    values = path.with_suffix(".json")
    files = [g for g in inputs if isinstance(g, str | os.PathLike)]
    refuse_existing(path, force)
    refuse_input(path, *files)
    if path.suffix.lower() not in ENDINGS:
        raise GonioError(f"{path} is no name of a page; end it in .html (its values go to {values.name} beside it)")
    refuse_existing(values, force)
    refuse_input(values, *files)
    folder = path.absolute().parent
    if not folder.is_dir():
        raise GonioError(f"the folder {folder} of {path} does not exist; make it first")
    if not os.access(folder, os.W_OK):
        raise GonioError(f"{path} cannot be written (Permission denied); choose a folder you may write to")
    return values


def _refuse_figures(folder: Path, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise GonioError(f"{folder} is a file; name a folder for the figures")
    if not folder.absolute().parent.is_dir():
        raise GonioError(f"the folder {folder.absolute().parent} of {folder} does not exist; make it first")
    if not force and folder.is_dir() and any(folder.iterdir()):
        raise GonioError(f"{folder} holds files already; name another folder, or --force to write among them")


def _certify(shown: Sequence[Subject], certificates, check: bool, against: Any) -> None:
    from gonio.checks.certify import check as judge

    truth = against
    for k, s in enumerate(shown):
        if certificates is not None and certificates[k] is not None:
            s.certificate = certificates[k]
        elif check and (s.table is None or s.table.counts()["valid"]):
            s.certificate = judge(s.table if s.table is not None else s.material or s.brdf, against=truth, name=s.name)


def _figure_files(drawn: dict[str, Drawn], shown: Sequence[Subject]) -> dict[str, bytes]:
    """What every figure's files hold, by their names."""
    names = {s.anchor: f"{s.number + 1:02d}-{_safe(s.name)}" for s in shown}
    files = {}
    for d in drawn.values():
        anchor = d.id.removesuffix(f"-{d.slug}")
        stem = f"{names.get(anchor, anchor)}-{d.slug}"
        files |= {f"{stem}.svg": d.picture.svg_file(), f"{stem}.png": d.picture.png()}
    return files


def _write(folder: Path, files: dict[str, bytes]) -> None:
    with output_errors(folder):
        folder.mkdir(exist_ok=True)
    with contextlib.ExitStack() as stack:
        for name, data in files.items():
            stack.enter_context(new_file(folder / name, force=True)).write_bytes(data)


def _safe(name: str) -> str:
    """A part of a file's name that every system takes."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._")[:60] or "subject"
