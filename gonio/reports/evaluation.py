"""What the figures of a subject show: readings, values of its models, its interpolation where there is one."""

import dataclasses
import functools
from typing import Any

import numpy as np

from gonio.data.interpolation.coverage import covered
from gonio.figures import readings, sampling
from gonio.figures.sampling import INCIDENCES, MAP_INCIDENCES, ModelValues, model_values
from gonio.figures.style import Picture
from gonio.models.errors import GonioError
from gonio.reports.subject import ReportSubject

INTERPOLATED = "readings, interpolated"


@dataclasses.dataclass
class Evaluation:
    """Readings of a subject near some incidences (degrees), values of its models, and of its interpolated table."""

    incidences: list[float]
    map_incidences: list[float]
    near: dict[float, readings.Readings]
    models: list[tuple[str, ModelValues]]
    """A model, or the fits of a table, by name."""
    interpolated: ModelValues | None
    """Not a number outside of the hull of what was read."""
    interpolation: str
    """How a table is interpolated, or why it cannot be."""

    @property
    def model(self) -> ModelValues | None:
        """The model, or the first fit."""
        return self.models[0][1] if self.models else None

    @property
    def sources(self) -> list[tuple[str, ModelValues]]:
        """(name, values) of what has a value in most directions: the interpolated table, the models."""
        return ([(INTERPOLATED, self.interpolated)] if self.interpolated is not None else []) + self.models


def evaluate_subject(s: ReportSubject) -> Evaluation:
    """Evaluates a subject for its figures."""
    if s.table is None:
        incidences, maps = list(INCIDENCES), list(MAP_INCIDENCES)
        values = model_values(s.model, s.channels, s.shown, incidences, maps)
        return Evaluation(incidences, maps, {}, [("model", values)], None, "")
    incidences, maps = (readings.table_incidences(s.table, wanted) for wanted in (INCIDENCES, MAP_INCIDENCES))
    every = sorted({*incidences, *maps})
    near = dict(zip(every, readings.readings_near(s.table, every), strict=True))
    models = [
        (s.fit_name(k), model_values(fit.brdf, s.channels, s.shown, incidences, maps)) for k, fit in enumerate(s.fits)
    ]
    interpolated, how = None, "readings in one plane do not cover the hemisphere"
    if not s.table.layout.in_one_plane:
        from gonio.data.interpolation.multilinear import as_material, interpolation

        try:
            table, shown = sampling.fewer_channels(s.table, s.shown)
            inside = functools.partial(covered, table)
            interpolated = model_values(as_material(table), table.channels, shown, incidences, maps, inside)
            how = interpolation(s.table)
        except GonioError as error:
            how = str(error)
    return Evaluation(incidences, maps, near, models, interpolated, how)


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
