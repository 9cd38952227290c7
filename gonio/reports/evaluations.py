"""What is seen of one subject, evaluated once for all of its figures."""

import dataclasses

from gonio.models.errors import GonioError
from gonio.reports import views
from gonio.reports.subject import Subject
from gonio.reports.views import Views


@dataclasses.dataclass
class Seen:
    """A subject's readings near some incidences (degrees), its model's views, and those of its interpolated table."""

    incidences: list[float]
    maps_at: list[float]
    near: dict[float, dict]
    model: Views | None
    between: Views | None
    """Of a table: read by its own interpolation."""
    how: str
    """How that interpolates, or why it cannot."""

    def sources(self, s: Subject) -> list[tuple[str, Views]]:
        """(name, views) of what can be looked at in any direction: the interpolated table, the model."""
        if s.table is None:
            return [("model", self.model)] if self.model is not None else []
        named = (("readings, interpolated", self.between), ("model fitted", self.model))
        return [(name, v) for name, v in named if v is not None]


def look(s: Subject) -> Seen:
    """Evaluates a subject for its figures."""
    if s.table is None:
        incidences, maps_at = list(views.INCIDENCES), list(views.MAP_INCIDENCES)
        return Seen(incidences, maps_at, {}, views.views(s.brdf, s.channels, s.shown, incidences, maps_at), None, "")
    incidences = views.table_incidences(s.table, views.INCIDENCES)
    maps_at = views.table_incidences(s.table, views.MAP_INCIDENCES)
    every = sorted({*incidences, *maps_at})
    near = dict(zip(every, views.readings_near(s.table, every), strict=True))
    model = None if s.fitted is None else views.views(s.fitted, s.channels, s.shown, incidences, maps_at)
    between, how = None, "readings in one plane do not cover the hemisphere"
    if s.table.layout.name != "in_plane":
        from gonio.data.interpolation.multilinear import as_material, interpolation

        try:
            table, shown = views.fewer_channels(s.table, s.shown)
            between = views.views(as_material(table), table.channels, shown, incidences, maps_at)
            how = interpolation(s.table)
        except GonioError as error:
            how = str(error)
    return Seen(incidences, maps_at, near, model, between, how)
