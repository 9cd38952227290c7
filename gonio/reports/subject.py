"""What a report is about: tables and models with their fits and certificates, from whatever a user names."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gonio.checks.certificate import Certificate
from gonio.data.material import Material
from gonio.data.subject import SubjectLike, load_material, resolve_subject
from gonio.data.table import Channels, Table
from gonio.fitting.result import FitResult
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import channel_count


@dataclasses.dataclass
class Subject:
    """A table or a model in a report: its file, its fit, its certificate, and its place in colour."""

    name: str
    channels: Channels
    brdf: AbstractBRDF | None = None
    table: Table | None = None
    material: Material | None = None
    fit: FitResult | None = None
    fit_material: Material | None = None
    certificate: Certificate | None = None
    number: int = 0
    file: str | None = None
    """The file it was read from."""

    @property
    def anchor(self) -> str:
        """Where its section begins."""
        return f"subject-{self.number + 1}"

    @property
    def kind(self) -> str:
        """table or model."""
        return "model" if self.table is None else "table"

    @property
    def shown(self) -> int:
        """The channel that the pictures show: the middle one."""
        return len(self.channels) // 2

    @property
    def channel(self) -> str:
        """Its name."""
        return self.channels.names[self.shown]

    @property
    def fitted(self) -> AbstractBRDF | None:
        """The model fitted to the table, if one was given."""
        if self.fit is not None:
            return self.fit.brdf
        return None if self.fit_material is None else self.fit_material.brdf


def subject_of(given: SubjectLike, number: int) -> Subject:
    """The report's subject of what `resolve_subject` takes. Raises GonioError as that does."""
    found = resolve_subject(given)
    brdf = None if found.material is None else found.material.brdf
    return Subject(found.name, found.channels, brdf, found.table, found.material, number=number, file=found.file)


def told_apart(shown: Sequence[Subject]) -> None:
    """Gives subjects of one name the names of their files, or numbers, beside it."""
    for name in {s.name for s in shown}:
        same = [s for s in shown if s.name == name]
        files = [Path(s.file).name if s.file else "" for s in same]
        for k, s in enumerate(same if len(same) > 1 else []):
            alone = files[k] and files.count(files[k]) == 1
            s.name = f"{name} ({files[k] if alone else k + 1})"


def fit_of(given: Any) -> FitResult | Material:
    """A fit result, or a fitted material. Raises GonioError for one that is not."""
    if isinstance(given, FitResult):
        return given
    material = given if isinstance(given, Material) else load_material(given)
    if "fit" not in material.meta:
        raise GonioError(f"{material.name} is not a fitted material; give one that 'gonio fit' wrote.")
    return material


def pair(shown: Sequence[Subject], fits: Sequence[FitResult | Material]) -> None:
    """Gives each fit to the table that it names, the others to what is left, in order.

    Raises GonioError where there are more fits than tables, and where a fit is of another table or of other channels.
    """
    tables = [s for s in shown if s.table is not None]
    if len(fits) > len(tables):
        raise GonioError(f"{len(fits)} fits came for {len(tables)} tables; give each table at most one fit.")
    left = []
    for fit in fits:
        named = _table_of(fit)
        mine = next((s for s in tables if s.name == named and s.fitted is None), None)
        if mine is None:
            left.append(fit)
        else:
            _give(mine, fit)
    for fit in left:
        free = [s for s in tables if s.fitted is None]
        named = _table_of(fit)
        if named:
            names = ", ".join(s.name for s in free)
            raise GonioError(f"The fit is of the table '{named}', not of {names}; give the fit of that table.")
        _give(free[0], fit)


def _table_of(fit: FitResult | Material) -> str | None:
    return fit.table if isinstance(fit, FitResult) else fit.meta["fit"].get("table")


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
