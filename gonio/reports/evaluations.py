"""The values that all figures of a subject show, evaluated once."""

import dataclasses

from gonio.figures.model_values import INCIDENCES, MAP_INCIDENCES, ModelValues, fewer_channels, model_values
from gonio.figures.readings import Readings, readings_near, table_incidences
from gonio.models.errors import GonioError
from gonio.reports.subject import ReportSubject


@dataclasses.dataclass
class Evaluation:
    """Readings of a subject near some incidences (degrees), values of its model, and of its interpolated table."""

    incidences: list[float]
    map_incidences: list[float]
    near: dict[float, Readings]
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
        values = model_values(s.model, s.channels, s.shown, INCIDENCES, MAP_INCIDENCES)
        return Evaluation(list(INCIDENCES), list(MAP_INCIDENCES), {}, values, None, "")
    incidences, maps = (table_incidences(s.table, wanted) for wanted in (INCIDENCES, MAP_INCIDENCES))
    every = sorted({*incidences, *maps})
    near = dict(zip(every, readings_near(s.table, every), strict=True))
    model = None if s.fitted is None else model_values(s.fitted, s.channels, s.shown, incidences, maps)
    interpolated, how = None, "readings in one plane do not cover the hemisphere"
    if not s.table.layout.in_one_plane:
        from gonio.data.interpolation.multilinear import as_material, interpolation

        try:
            table, shown = fewer_channels(s.table, s.shown)
            interpolated = model_values(as_material(table), table.channels, shown, incidences, maps)
            how = interpolation(s.table)
        except GonioError as error:
            how = str(error)
    return Evaluation(incidences, maps, near, model, interpolated, how)
