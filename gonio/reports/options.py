"""The options of a report: the public keywords of `gonio.report`, and the same checked."""

import dataclasses
import errno
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypedDict

from gonio.checks.certificate import Certificate
from gonio.data.files import output_errors, refuse_existing, refuse_input
from gonio.models.errors import GonioError

MOST_SUBJECTS = 50
ENDINGS = (".html", ".htm")


class ReportOptions(TypedDict, total=False):
    """Keywords of `gonio.report`; `help(gonio.report)` describes each."""

    fits: Sequence[Any]
    certificates: Sequence[Certificate | None] | None
    check: bool
    against: Any
    chart: str | os.PathLike[str] | None
    figures: str | os.PathLike[str] | None
    title: str
    command: str | None
    force: bool


@dataclasses.dataclass(frozen=True)
class ReportSettings:
    """The options of a report, complete; see `gonio.report`."""

    fits: Sequence[Any] = ()
    certificates: Sequence[Certificate | None] | None = None
    check: bool = True
    against: Any = None
    chart: str | os.PathLike[str] | None = None
    figures: str | os.PathLike[str] | None = None
    title: str = "BRDF report"
    command: str | None = None
    force: bool = False

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
        values = path.with_suffix(".json")
        index = [] if self.chart is None else [Path(self.chart) / "charts.json"]
        inputs = [g for g in (*subjects, *self.fits, self.against, *index) if isinstance(g, str | os.PathLike)]
        refuse_existing(path, self.force)
        refuse_input(path, *inputs)
        if path.suffix.lower() not in ENDINGS:
            raise GonioError(f"{path} is no name of a page; end it in .html (its values go to {values.name} beside it)")
        refuse_existing(values, self.force)
        refuse_input(values, *inputs)
        _require_writable_folder(path)
        return values

    def refuse_figures(self) -> None:
        """Refuses a folder of figures that cannot be made, or that holds files already."""
        if self.figures is None:
            return
        folder = Path(self.figures)
        if folder.exists() and not folder.is_dir():
            raise GonioError(f"{folder} is a file; name a folder for the figures")
        _require_writable_folder(folder)
        if not self.force and folder.is_dir() and any(folder.iterdir()):
            raise GonioError(f"{folder} holds files already; name another folder, or --force to write among them")


def _require_writable_folder(path: Path) -> None:
    with output_errors(path):
        if not os.access(path.absolute().parent, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
