"""Selection of a model on readings brought to the centres of their apertures' discs, or of their file's patches.

Candidates are compared at the centres: left there, averages ask for lobes that the material does not have.
What averages differ by from the centres comes from a fit of averages, first of a plain model, then of the selected one.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.fitting.fit_model import FitTask, fit_model
from gonio.fitting.patches import Patches, fit_patches
from gonio.fitting.refinement import noise_of
from gonio.fitting.selection.automatic import Selection, select_model
from gonio.fitting.selection.scene_selection import SceneView
from gonio.models.errors import GonioError
from gonio.models.expression.parser import Term, parse, with_defaults

PLAIN = (  # isotropic, anisotropic
    ("lambert + ggx(f0=?)", "lambert + ggx(f0=?) + ggx"),
    ("lambert + ggx(alpha_x=?, alpha_y=?, f0=?)", "lambert + ggx(alpha_x=?, alpha_y=?, f0=?) + ggx"),
)
PLAIN_THROUGH = ("thin_sheet + transmitted(base=ggx)",)
PLAIN_IN_PATCHES = (("lambert + ggx",), ("lambert + ggx(alpha_x=?, alpha_y=?)",))  # wide ones tell no f0 from a scale
POOR = 1.5  # mean squared residual in units of the noise, from which on the next plain model is tried
SELECTIONS = 3
SAME = 1.0  # standard uncertainties, over all readings, that a correction may change by


def selected_model(
    task: FitTask, anisotropic: bool, view: SceneView | None, patches: Patches | None = None
) -> Selection:
    """The model that a task's readings ask for; the other arguments are those of `select_model` and `fit_patches`."""
    settings, before = task.settings, ""
    averaged = (any(task.readings.half_angles) or patches is not None) and settings.aperture == "average"
    correction = _Correction(np.zeros(1), 0.0, np.inf)
    transmits = task.readings.sides != [(1, 1)]
    in_front = (PLAIN if patches is None else PLAIN_IN_PATCHES)[anisotropic]
    for plain in (PLAIN_THROUGH if transmits else in_front) if averaged else ():
        if correction.misfit > POOR:
            correction = _correction(task, plain, with_defaults(parse(plain)), np.zeros(1), patches)
    averaged = correction.change > SAME
    for _ in range(SELECTIONS):
        readings = task.readings
        if correction.shift.any():
            readings = dataclasses.replace(readings.in_memory, f=readings.f - correction.shift)
        selection = select_model(readings, task.loss, task.sigma, anisotropic, settings.seed, settings.log, view)
        if not averaged or selection.expression == before:
            break
        before = selection.expression
        correction = _correction(task, before, selection.terms, correction.shift, patches)
        if correction.change < SAME:
            break
        where = "discs" if patches is None else "patches"
        settings.log(
            f"averages: with {before} the readings at the centres of their {where} are others; selecting again"
        )
    return selection


class _Correction(NamedTuple):
    """What averages over discs or patches differ by from the values at their centres, (n, C), by a fit.

    `change`: from the correction before, in standard uncertainties over all readings; `misfit`: mean squared residual
    of the fit in units of the noise.
    """

    shift: np.ndarray
    change: float
    misfit: float


def _correction(
    task: FitTask, model: str, terms: tuple[Term, ...], before: np.ndarray, patches: Patches | None
) -> _Correction:
    settings = dataclasses.replace(task.settings, starts=1, per_channel=False)
    task = dataclasses.replace(task, requested=model, terms=terms, settings=settings)
    try:
        means = None if patches is None else fit_patches(task, patches)
        e = (fit_model(task) if means is None else means.optima)[0]
    except GonioError:  # too few readings for this model
        return _Correction(before, 0.0, 0.0)
    if means is None:
        shift = e.model_f - e.problem.averaged(None).model_values(e.p)
    else:
        shift = task.readings.f - means.task.readings.f
    rms = noise_of(e.problem, e.p.size, e.cost)
    change = np.linalg.norm(e.problem.linearised().weight * (shift - before)) / (1.0 if task.likelihood else rms)
    return _Correction(shift, float(change), rms**2 if task.likelihood else 1.0)
