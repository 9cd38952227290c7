"""Subjects of a report: tables and models with their fits, their certificates and the values that figures show."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gonio.checks.certificate import Certificate
from gonio.data.material import Material
from gonio.data.subject import SubjectLike, load_material, resolve_subject
from gonio.data.table import Channels, Table
from gonio.figures import sampling
from gonio.figures.sampling import INCIDENCES, MAP_INCIDENCES, ModelValues, model_values
from gonio.figures.style import LineStyle, Picture, colour_of
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import channel_count


@dataclasses.dataclass
class ReportSubject:
    """A table or a model in a report, with its fit, its certificate, and its place in colour."""

    name: str
    channels: Channels
    table: Table | None
    material: Material | None
    file: str | None
    """The file it was read from."""
    number: int
    fit: Material | None = None
    """The material that was fitted to the table."""
    certificate: Certificate | None = None

    @property
    def anchor(self) -> str:
        """Id of the heading of its section."""
        return f"subject-{self.number + 1}"

    @property
    def look(self) -> LineStyle:
        """Its line in figures of several subjects."""
        return colour_of(self.number)

    @property
    def model(self) -> AbstractBRDF:
        """The BRDF of a model."""
        assert self.material is not None, f"{self.name} is a table"
        return self.material.brdf

    @property
    def empty(self) -> bool:
        """Whether it is a table without a valid reading."""
        return self.table is not None and self.table.counts()["valid"] == 0

    @property
    def shown(self) -> int:
        """Number of the channel that the pictures show: the middle one."""
        return len(self.channels) // 2

    @property
    def channel(self) -> str:
        """Name of the shown channel."""
        return self.channels.names[self.shown]

    @property
    def fitted(self) -> AbstractBRDF | None:
        """The model fitted to the table, if one was given."""
        return None if self.fit is None else self.fit.brdf


def subject_of(given: SubjectLike, number: int) -> ReportSubject:
    """The report's subject of what `resolve_subject` takes. Raises GonioError as that does."""
    s = resolve_subject(given)
    return ReportSubject(s.name, s.channels, s.table, s.material, s.file, number)


def distinguish_names(subjects: Sequence[ReportSubject]) -> None:
    """Gives subjects of one name the names of their files, or numbers, beside it."""
    for name in {s.name for s in subjects}:
        same = [s for s in subjects if s.name == name]
        files = [Path(s.file).name if s.file else "" for s in same]
        for k, s in enumerate(same if len(same) > 1 else []):
            unique = files[k] and files.count(files[k]) == 1
            s.name = f"{name} ({files[k] if unique else k + 1})"


def fit_of(given: SubjectLike) -> Material:
    """A fitted material, of a fit result too. Raises GonioError for one that is not."""
    material = load_material(given)
    if "fit" not in material.meta:
        raise GonioError(f"{material.name} is not a fitted material; give one that 'gonio fit' wrote.")
    return material


def assign_fits(subjects: Sequence[ReportSubject], fits: Sequence[Material]) -> None:
    """Gives each fit to the table that it names, the others to the remaining tables, in order.

    Raises GonioError where there are more fits than tables, and where a fit is of another table or of other channels.
    """
    tables = [s for s in subjects if s.table is not None]
    if len(fits) > len(tables):
        raise GonioError(f"{len(fits)} fits came for {len(tables)} tables; give each table at most one fit.")
    # Those that name a table of the page first, so that none of it is taken.
    for fit in sorted(fits, key=lambda f: _table_name(f) not in {s.name for s in tables}):
        name = _table_name(fit)
        free = [s for s in tables if s.fit is None]
        match = next((s for s in free if s.name == name), None)
        if match is None and name:
            names = ", ".join(s.name for s in free)
            raise GonioError(f"The fit is of the table '{name}', not of {names}; give the fit of that table.")
        table = match or free[0]
        count = channel_count(fit.brdf)
        if count not in (None, len(table.channels)):
            counts = f"The fit has {count} channels and {table.name} has {len(table.channels)}"
            raise GonioError(f"{counts}; give the fit of that table.")
        table.fit = fit


def _table_name(fit: Material) -> str | None:
    return fit.meta["fit"].get("table")


@dataclasses.dataclass
class Evaluation:
    """Readings of a subject near some incidences (degrees), values of its model, and of its interpolated table."""

    incidences: list[float]
    map_incidences: list[float]
    near: dict[float, sampling.Readings]
    model: ModelValues | None
    interpolated: ModelValues | None
    interpolation: str
    """How a table is interpolated, or why it cannot be."""

    def sources(self, s: ReportSubject) -> list[tuple[str, ModelValues]]:
        """(name, values) of what has a value in every direction: the interpolated table, the model."""
        if s.table is None:
            return [("model", self.model)] if self.model is not None else []
        named = (("readings, interpolated", self.interpolated), ("model fitted", self.model))
        return [(name, values) for name, values in named if values is not None]


def evaluate_subject(s: ReportSubject) -> Evaluation:
    """Evaluates a subject for its figures."""
    if s.table is None:
        incidences, maps = list(INCIDENCES), list(MAP_INCIDENCES)
        return Evaluation(incidences, maps, {}, model_values(s.model, s.channels, s.shown, incidences, maps), None, "")
    incidences, maps = (sampling.table_incidences(s.table, wanted) for wanted in (INCIDENCES, MAP_INCIDENCES))
    every = sorted({*incidences, *maps})
    near = dict(zip(every, sampling.readings_near(s.table, every), strict=True))
    model = None if s.fitted is None else model_values(s.fitted, s.channels, s.shown, incidences, maps)
    interpolated, how = None, "readings in one plane do not cover the hemisphere"
    if not s.table.layout.in_one_plane:
        from gonio.data.interpolation.multilinear import as_material, interpolation

        try:
            table, shown = sampling.fewer_channels(s.table, s.shown)
            interpolated = model_values(as_material(table), table.channels, shown, incidences, maps)
            how = interpolation(s.table)
        except GonioError as error:
            how = str(error)
    return Evaluation(incidences, maps, near, model, interpolated, how)


@dataclasses.dataclass(frozen=True)
class ReportFigure:
    """A picture with its caption; `data` holds the numbers that it shows, as JSON can hold them."""

    slug: str
    caption: str
    picture: Picture
    data: dict[str, Any]
    kind: str = "panel"
    """panel, small (some in a row), bar (a colour scale below them) or space (a lobe to be turned)."""


def rounded(values: Any, digits: int = 6) -> Any:
    """Nested lists of numbers at so many significant digits; None where there is no finite one."""
    if isinstance(values, np.ndarray | list | tuple):
        return [rounded(v, digits) for v in values]
    value = float(values)
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None
