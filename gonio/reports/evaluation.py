"""What the figures of a subject show: readings, values of its models, its interpolation where there is one."""

import dataclasses
import functools
import math
from typing import Any

import numpy as np

from gonio.data.interpolation.coverage import covered
from gonio.figures import readings, sampling
from gonio.figures.sampling import INCIDENCES, MAP_INCIDENCES, ModelValues, model_values
from gonio.figures.style import Picture
from gonio.models.errors import GonioError
from gonio.models.geometry.sides import Hemispheres
from gonio.reports.subject import ReportSubject

INTERPOLATED = "readings, interpolated"
LIT_IN_FRONT, LIT_BEHIND = ", light from the front", ", light from behind, the sample turned over"
ALIKE = ", light from either side alike"


@dataclasses.dataclass
class Evaluation:
    """Readings of a subject near some incidences (degrees), values of its models, and of its interpolated table.

    All is of light on one side of the sample; polar angles are counted from the normal there.
    """

    incidences: list[float]
    map_incidences: list[float]
    near: dict[float, readings.Readings]
    models: list[tuple[str, ModelValues]]
    """A model, or the fits of a table, by name."""
    interpolated: ModelValues | None
    """Not a number outside of the hull of what was read."""
    interpolation: str
    """How a table is interpolated, or why it cannot be."""
    lit: str = ""
    """The side of the light in words that end a caption; empty where no other was read or scatters."""
    behind: "Evaluation | None" = None
    """The same of light from behind, where that was read, or a model scatters it otherwise than from the front."""

    @property
    def model(self) -> ModelValues | None:
        """The model, or the first fit."""
        return self.models[0][1] if self.models else None

    @property
    def sources(self) -> list[tuple[str, ModelValues]]:
        """(name, values) of what has a value in most directions: the interpolated table, the models."""
        return ([(INTERPOLATED, self.interpolated)] if self.interpolated is not None else []) + self.models


def evaluate_subject(s: ReportSubject) -> Evaluation:
    """Evaluates a subject for its figures, for light in front and, where there is such, from behind."""
    front = _lit_from(s, 1)
    if not _lit_behind(s):
        return front
    behind = _lit_from(s, -1)
    if s.table is None and _alike(front.models[0][1], behind.models[0][1]):
        return dataclasses.replace(front, lit=ALIKE)
    return dataclasses.replace(front, lit=LIT_IN_FRONT, behind=dataclasses.replace(behind, lit=LIT_BEHIND))


def _lit_behind(s: ReportSubject) -> bool:
    if s.table is not None:
        return any(light < 0 for light, _ in s.table.sides)
    return bool(s.model.hemispheres & (Hemispheres.BACK | Hemispheres.TRANSMISSION))


def _alike(a: ModelValues, b: ModelValues) -> bool:
    pairs = zip([*a.curves, *a.meshes, a.slice], [*b.curves, *b.meshes, b.slice], strict=True)
    return all(np.allclose(x, y, rtol=1e-6, atol=1e-9 * np.max(np.abs(x), initial=0.0)) for x, y in pairs)


def _lit_from(s: ReportSubject, light: int) -> Evaluation:
    """The evaluation for light on one side, 1 in front or −1 behind."""
    if s.table is None:
        incidences, maps = list(INCIDENCES), list(MAP_INCIDENCES)
        values = model_values(s.model, s.channels, s.shown, incidences, maps, light=light)
        return Evaluation(incidences, maps, {}, [("model", values)], None, "")
    incidences, maps = (readings.table_incidences(s.table, wanted, light) for wanted in (INCIDENCES, MAP_INCIDENCES))
    every = sorted({*incidences, *maps})
    near = dict(zip(every, readings.readings_near(s.table, every, light), strict=True))
    models = [
        (s.fit_name(k), model_values(fit.brdf, s.channels, s.shown, incidences, maps, light=light))
        for k, fit in enumerate(s.fits)
    ]
    interpolated, how = None, "readings in one plane do not cover the hemisphere"
    if not s.table.layout.in_one_plane:
        from gonio.data.interpolation.multilinear import as_material, interpolation

        try:
            table, shown = sampling.fewer_channels(s.table, s.shown)
            inside = functools.partial(covered, table)
            interpolated = model_values(as_material(table), table.channels, shown, incidences, maps, inside, light)
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
    if isinstance(values, np.ndarray) and values.ndim == 1:
        form, finite = f".{digits}g", math.isfinite
        return [float(format(v, form)) if finite(v) else None for v in values.astype(float).tolist()]
    if isinstance(values, np.ndarray | list | tuple):
        return [rounded(v, digits) for v in values]
    value = float(values)
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
