"""Selection of a model on readings brought to the centres of their apertures' discs.

Candidates are compared at the centres: left there, averages over discs ask for lobes that the material does not have.
What averages differ by from the centres comes from a fit of averages, first of a plain model, then of the selected one.
"""

import dataclasses

import numpy as np

from gonio.fitting.fit_model import FitTask, fit_model
from gonio.fitting.refinement import noise_of
from gonio.fitting.selection.automatic import Selection, select_model
from gonio.fitting.selection.scene_selection import SceneView
from gonio.models.errors import GonioError
from gonio.models.expression.parser import Term, parse, with_defaults

PLAIN = ("lambert + ggx(f0=?)", "lambert + ggx(alpha_x=?, alpha_y=?, f0=?)")  # isotropic, anisotropic
SELECTIONS = 3
SAME = 1.0  # standard uncertainties, over all readings, that a correction may change by


def selected_model(task: FitTask, anisotropic: bool, view: SceneView | None) -> Selection:
    """The model that a task's readings ask for; the other arguments are those of `select_model`."""
    settings, before = task.settings, ""
    averaged = any(task.readings.half_angles) and settings.aperture == "average"
    shift = np.zeros(1)
    if averaged:
        shift, size = _shift(task, PLAIN[anisotropic], with_defaults(parse(PLAIN[anisotropic])), shift)
        averaged = size > SAME
    for _ in range(SELECTIONS):
        readings = dataclasses.replace(task.readings, f=task.readings.f - shift)
        selection = select_model(readings, task.loss, task.sigma, anisotropic, settings.seed, settings.log, view)
        if not averaged or selection.expression == before:
            break
        before = selection.expression
        shift, change = _shift(task, before, selection.terms, shift)
        if change < SAME:
            break
        settings.log(f"apertures: with {before} the readings at the centres of their discs are others; selecting again")
    return selection


def _shift(task: FitTask, model: str, terms: tuple[Term, ...], before: np.ndarray) -> tuple[np.ndarray, float]:
    """(averages over the discs less the values at their centres (n, C), change in standard uncertainties over all)."""
    settings = dataclasses.replace(task.settings, starts=1, per_channel=False)
    try:
        e = fit_model(dataclasses.replace(task, requested=model, terms=terms, settings=settings))[0]
    except GonioError:  # too few readings for this model
        return before, 0.0
    shift = e.model_f - e.problem.averaged(None).model_values(e.p)
    noise = 1.0 if task.likelihood else noise_of(e.problem, e.p.size, e.cost)
    return shift, float(np.linalg.norm(e.problem.linearised().weight * (shift - before)) / noise)
