"""Automatic choice of a model for readings, as an expression whose fit starts from the selection's numbers."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.data.layouts import Layout
from gonio.fitting.problem.readings import Readings
from gonio.fitting.selection.candidate import Candidate, SelectionResult
from gonio.fitting.selection.candidate_columns import candidate_parameters
from gonio.fitting.selection.scene_selection import SceneSelection, SceneView, select_for_scene
from gonio.fitting.selection.stepwise import stepwise_selection
from gonio.models.expression.parser import Term, Value, changed, numbers, parse, with_defaults


def shows_anisotropy(layout: Layout, readings: Readings) -> bool:
    """Whether readings can show that a surface is anisotropic: the light comes from more than one azimuth."""
    if not layout.has_azimuth_of_light:
        return False
    azimuths = set[float]()
    for part in readings.parts():
        x, y = (np.asarray(c, float) for c in (part.wi.x, part.wi.y))
        oblique = np.hypot(x, y) > 1e-6
        azimuths.update(np.unique(np.round(np.arctan2(y[oblique], x[oblique]), 4)).tolist())
        if len(azimuths) > 1:
            return True
    return False


@dataclasses.dataclass(frozen=True)
class Selection:
    """The selected model: its expression, its terms with their starts, and how it was selected."""

    expression: str
    terms: tuple[Term, ...]
    result: SelectionResult
    scene: SceneSelection | None = None

    def rows(self) -> list[dict[str, Any]]:
        """The candidates as plain data."""
        return self.result.rows() if self.scene is None else self.scene.rows()


def select_model(
    readings: Readings,
    loss: str,
    sigma: np.ndarray | None,
    anisotropic: bool,
    seed: int,
    log: Callable[[str], None],
    view: SceneView | None = None,
) -> Selection:
    """The model that readings ask for; with the view of a scene, the cheapest one within its tolerance.

    With a loss that needs a noise that is not known yet (relative to the model's own f), the structure is selected by
    the cube root; the noise is estimated from the readings either way. The other arguments are those of
    `stepwise_selection`.
    """
    if loss == "sigma" and sigma is None:
        loss = "cbrt"
    cells = None if view is None else view.cells
    result = stepwise_selection(readings, loss, sigma, anisotropic, seed, log, cells)
    scene = None if view is None else select_for_scene(result, view)
    chosen = result.chosen if scene is None else scene.chosen.candidate
    terms = _with_starts(chosen, result.data.channels, readings.f.shape[1])
    return Selection(chosen.expression, terms, result, scene)


def _with_starts(candidate: Candidate, channels: int, of_table: int) -> tuple[Term, ...]:
    """The terms of a candidate over some channels, its numbers as starts of a fit of all channels of a table."""
    free = candidate_parameters(candidate.terms, channels).parameterisation
    terms = with_defaults(parse(candidate.expression))
    starts: list[dict[str, Value]] = [{n.path: n.value for n in numbers(t)} for t in terms]
    for g in free.free:
        values = candidate.p[free.of(g)].tolist()
        if not g.per_channel:
            starts[g.term][g.path] = Value(values[0], free=True, each=starts[g.term][g.path].each)
        elif channels == of_table:  # channels beyond those of the selection start where the data put them
            starts[g.term][g.path] = Value(tuple(values), free=True)
    return tuple(map(changed, terms, starts))
