"""`report`: tables, fits, checks and pictures in one self-contained page, and every value of it beside the page."""

import contextlib
import dataclasses
import json
import os
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

from gonio.checks.certificate import Certificate
from gonio.data.files import new_file, output_errors, refuse_outputs, require_writable_folder
from gonio.models.deprecation import settings_of
from gonio.models.errors import GonioError, printable
from gonio.reports.document import Document, assemble
from gonio.reports.page import page
from gonio.reports.subject import ReportSubject, assign_fits, distinguish_names, fit_of, split_fits, subject_of

MOST_SUBJECTS = 50
ENDINGS = (".html", ".htm")
SILENT = 2.0


class ReportOptions(TypedDict, total=False):
    """Keywords of `gonio.report`; `help(gonio.report)` describes each."""

    fits: Sequence[Any]
    certificates: Sequence[Certificate | None] | None
    check: bool
    against: Any
    chart: str | os.PathLike[str] | None
    figures: str | os.PathLike[str] | None
    render: bool
    title: str
    command: str | None
    force: bool
    log: Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class ReportSettings:
    """The options of a report, complete; see `gonio.report`."""

    fits: Sequence[Any] = ()
    certificates: Sequence[Certificate | None] | None = None
    check: bool = True
    against: Any = None
    chart: str | os.PathLike[str] | None = None
    figures: str | os.PathLike[str] | None = None
    render: bool = False
    title: str = "BRDF report"
    command: str | None = None
    force: bool = False
    log: Callable[[str], None] = lambda line: None

    def require_subjects(self, subjects: Sequence[Any]) -> None:
        """Refuses a number of subjects that no page holds, and certificates that do not match them."""
        if not subjects:
            raise GonioError("A report is about at least one table or material; none was given.")
        if len(subjects) > MOST_SUBJECTS:
            raise GonioError(
                f"A page holds at most {MOST_SUBJECTS} subjects and {len(subjects)} were given; make several pages."
            )
        if self.certificates is not None and len(self.certificates) != len(subjects):
            raise GonioError(
                f"{len(self.certificates)} certificates came for {len(subjects)} subjects; give one each, or None."
            )

    def values_file(self, output: str | os.PathLike[str], subjects: Sequence[Any]) -> Path:
        """The file of values beside the page, after both of them were found free to be written."""
        path = Path(output)
        index = [] if self.chart is None else [Path(self.chart) / "charts.json"]
        files = [getattr(g, "file", g) for g in (*subjects, *self.fits, self.against, *index)]
        inputs = [f for f in files if isinstance(f, str | os.PathLike)]
        refuse_outputs([path], inputs, self.force)
        values = path.with_suffix(".json")
        if path.suffix.lower() not in ENDINGS:
            raise GonioError(f"{path} is no name of a page; end it in .html (its values go to {values.name} beside it)")
        refuse_outputs([path, values], inputs, self.force)
        return values

    def refuse_figures(self) -> None:
        """Refuses a folder of figures that cannot be made, or that holds files already."""
        if self.figures is None:
            return
        folder = Path(self.figures)
        if folder.exists() and not folder.is_dir():
            raise GonioError(f"{folder} is a file; name a folder for the figures")
        require_writable_folder(folder)
        if not self.force and folder.is_dir() and any(folder.iterdir()):
            raise GonioError(f"{folder} holds files already; name another folder, or --force to write among them")


def report(
    subjects: Sequence[Any] | Any, output: str | os.PathLike[str] | None = None, **options: Unpack[ReportOptions]
) -> Path | str:
    """Writes a page about tables and models: verdicts first, lobes, maps, albedo, residuals, provenance.

    Beside the page (OUT.html) stands OUT.json with every value on it. Nothing is written before all is made.

    Args:
        subjects: tables, profiles, materials, models, fit results, or what names them (files, reference materials,
            expressions); one of them or a sequence. A fitted material that names a table or a profile among them is a
            fit of that.
        output: the page; None returns its text.
        fits: fit results, or fitted materials and their files; each goes to the table that it names, which may have
            several.
        certificates: one for each subject; None among them is made here.
        check: makes the certificates that are not given; true by default.
        against: a stated truth; agreement with it is checked too.
        chart: a folder that `gonio chart` wrote, whose charts back the settings.
        figures: a folder for every figure as SVG and PNG.
        render: shows a sphere of each subject that Mitsuba renders, with the errors of Mitsuba's expression.
        title: the heading of the page.
        command: shown as the way to make the page again.
        force: replaces existing outputs.
        log: called with a line for each step of a page that takes longer than two seconds.

    Returns:
        The path of the page, or its text.

    Raises:
        GonioError: for a subject that cannot be read, an output that exists or is an input, a fit of another table, and
            `render` without Mitsuba.
    """
    settings = settings_of(ReportSettings, "report", options)
    given = list(subjects) if isinstance(subjects, list | tuple) else [subjects]
    settings.require_subjects(given)
    values_file = None if output is None else settings.values_file(output, given)
    settings.refuse_figures()
    shown = _shown(given, settings)
    step = _Progress(len(shown), settings.log).step
    charts = []
    if settings.chart is not None:
        from gonio.reports.chart_folder import charts_of

        charts = charts_of(settings.chart)

    def certify(subjects: Sequence[ReportSubject]) -> None:
        _certify(subjects, settings, step)

    document = assemble(shown, settings.title, settings.command, charts, certify, step, settings.render)
    text = page(document, None if values_file is None else values_file.name)
    files: dict[Path, bytes] = {}
    if output is not None and values_file is not None:
        # A file's name may hold bytes that are no text.
        files = {Path(output): text.encode(errors="backslashreplace"), values_file: _values_text(document)}
    if settings.figures is not None:
        files |= _figure_files(Path(settings.figures), document, shown)
    _write(files, settings)
    return text if output is None else Path(output)


def _shown(given: Sequence[Any], settings: ReportSettings) -> list[ReportSubject]:
    """The subjects of the page, each with its fits and a name of its own."""
    if settings.render:
        from gonio.exports.preview import require_mitsuba  # the renderers' models are loaded with it

        require_mitsuba()
    of_page, fits = split_fits(given)
    shown = [subject_of(g, number) for number, g in enumerate(of_page)]
    if settings.render and all(s.profile is not None for s in shown):
        raise GonioError("a profile of light below a surface has no sphere to render; leave that out")
    assign_fits(shown, [fit_of(f) for f in (*settings.fits, *fits)])
    distinguish_names(shown)
    return shown


def _values_text(document: Document) -> bytes:
    """The file of all values of a page."""
    values = json.dumps(document.values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return f"{printable(values)}\n".encode()


def _write(files: dict[Path, bytes], settings: ReportSettings) -> None:
    """Writes all files, or none of them."""
    if settings.figures is not None:
        with output_errors(Path(settings.figures)):
            os.makedirs(settings.figures, exist_ok=True)
    with contextlib.ExitStack() as stack:
        for path, content in files.items():
            # The folder of figures was found empty, or may be written into.
            force = settings.force or path.suffix in (".svg", ".png")
            stack.enter_context(new_file(path, force)).write_bytes(content)


class _Progress:
    """Tells what comes next, once a page has taken `SILENT` seconds."""

    def __init__(self, count: int, log: Callable[[str], None]) -> None:
        self.count, self.log, self.began = count, log, time.perf_counter()

    def step(self, what: str, s: ReportSubject) -> None:
        seconds = time.perf_counter() - self.began
        if seconds > SILENT:
            self.log(f"{what} {s.number + 1} of {self.count}, {s.name} ({seconds:.0f} s so far)")


def _certify(
    subjects: Sequence[ReportSubject], settings: ReportSettings, step: Callable[[str, ReportSubject], None]
) -> None:
    from gonio.checks.certify import check

    for s, given in zip(subjects, settings.certificates or [None] * len(subjects), strict=True):
        if given is not None:
            s.certificate = given
        elif settings.check and not s.empty:
            step("checking", s)
            if s.profile is not None:
                s.certificate = check(s.profile, name=s.name)
                continue
            given = s.material if s.table is None else s.table
            s.certificate = check(given, against=settings.against, name=s.name, model=s.fitted_model)


def _figure_files(folder: Path, document: Document, subjects: Sequence[ReportSubject]) -> dict[Path, bytes]:
    """Contents of every figure's files, SVG and PNG; names take only letters that every system takes."""
    stems = {s.anchor: re.sub(r"[^A-Za-z0-9._-]+", "_", s.name).strip("._")[:60] or "subject" for s in subjects}
    names = {s.anchor: f"{s.number + 1:02d}-{stems[s.anchor]}" for s in subjects}
    files = {}
    for name, figure in document.figures.items():
        anchor = name.removesuffix(f"-{figure.slug}")
        stem = f"{names.get(anchor, anchor)}-{figure.slug}"
        files[folder / f"{stem}.svg"] = figure.picture.svg_file()
        files[folder / f"{stem}.png"] = figure.picture.png()
    return files
