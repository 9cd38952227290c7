"""From a table to a model: the one public function, `fit`."""

import dataclasses
import functools
import time
from typing import Any, NamedTuple, Unpack

import numpy as np

from gonio.data.interpolation.sheets import sheet_of
from gonio.data.plausibility.copies import Symmetry
from gonio.data.scene import Scene
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Table, index_of
from gonio.fitting.apertures import aperture_notes, half_angles_of, wide_notes
from gonio.fitting.assembly import assemble_result
from gonio.fitting.common_errors import common_error_note, common_errors
from gonio.fitting.fit_model import FitTask, compile_ahead
from gonio.fitting.options import FitOptions, FitSettings
from gonio.fitting.patches import Patches, fit_at_middles, fit_patches
from gonio.fitting.polarised import polarisation_notes, why_no_radiances
from gonio.fitting.problem.copies import distinct_readings, symmetry_of, weighted_as_read
from gonio.fitting.problem.readings import (
    NO_UNCERTAINTY,
    Readings,
    cell_weights,
    count_readings,
    readings_of,
    sigma_of,
    stored_readings,
)
from gonio.fitting.result import FitResult
from gonio.fitting.selected_model import selected_model
from gonio.fitting.selection.automatic import Selection, shows_anisotropy
from gonio.fitting.selection.scene_promise import promise
from gonio.fitting.selection.scene_selection import SceneView, view_of
from gonio.fitting.surface_azimuth import azimuth_notes
from gonio.models.errors import GonioError
from gonio.models.expression.builder import terms_to_expression
from gonio.models.expression.parser import Term, parse, with_defaults
from gonio.models.expression.wavelengths import with_wavelengths

IDEAL = "ideal"  # an instrument without errors, in the provenance of a simulation; of others a dict describes them
SELECTED_STARTS = 2  # random ones after a selection, which knows where to begin


def fit(table: SubjectLike, model: str | list[str] | None = None, **options: Unpack[FitOptions]) -> FitResult:
    """Fit a BRDF model to a table of readings, by nonlinear least squares with many starts.

    Args:
        table: a table, or anything that gives one: a path, an open file, a material or an expression.
        model: an expression such as ``"lambert + ggx(eta=1.5)"``; of several the one of the lowest BIC is returned;
            None selects one, adding a lobe at a time while BIC and cross-validation both improve. Free are omitted
            shape parameters, ``name=?``, ``name~v`` (from that start), and the scale of every lobe unless it is
            written (``1 * ggx(...)``); an omitted Fresnel parameter means F = 1. Albedos and scales are free in each
            channel, shapes are shared.
        loss: ``"sigma"``, ``"linear"``, ``"cbrt"``, ``"log"`` or ``"log1p"``; by default ``"sigma"`` where the table
            has standard uncertainties, else ``"cbrt"``.
        theta_max: largest polar angle of either direction, radians, in (0, π/2].
        weight: ``"solid-angle"``, ``"cosine"`` or ``"projected-solid-angle"``; by default cells weigh equally.
        relative_noise: standard uncertainty as a share of the model's own f, in (0, 1); reweighted until it settles.
        robust: ``"tukey"`` (or True), ``"student"`` or ``"soft-l1"``: outliers count less.
        bootstrap: number of refits to resampled blocks of neighbouring directions, 0 or from 2 to 100,000.
        bootstrap_kind: ``"wild"`` (random signs of the residuals) or ``"block_pairs"`` (resampled readings).
        per_channel: fit every channel by itself.
        samples: largest number of cells, at random by the seed; by default all.
        aperture: ``"average"``: the model is averaged over the discs of light and detector whose solid angles the table
            states, as its readings are; ``"ignore"``: it is compared at their centres.
        starts: number of random starts beside those from the data, 0 or more; at most 2 where the model was selected.
        scene: a scene, its file or the name of a shipped one: its directions are fitted, weighted by their effect on
            its radiance, and without a model the cheapest one within its tolerance is selected.
        seed: of starts, samples and bootstrap.
        log: called with a line for each model.

    Returns:
        The fitted model with uncertainties, tests of the residuals and notes; `converged` says whether it is
        stationary.

    Raises:
        GonioError: an unknown model, loss or weight, an option out of range, or too few readings for the model.
        TypeError: an unknown option.

    References:
        Moré 1978 (Levenberg–Marquardt); White 1980 (covariance); Schwarz 1978 (BIC); Wu 1986 (wild bootstrap).
    """
    settings = FitSettings.create(options)
    source = _source(table, settings)
    requests = _requests(model, source)
    began = time.perf_counter()
    if requests:
        loss = _usual_loss(settings, source.u_f is not None)
        compile_ahead(requests[0].terms, loss, len(source.channels), settings.per_channel)
    task = _task(source, settings, [m.terms for m in requests])
    seconds = {"read": time.perf_counter() - began}
    searching = settings.scene is not None or not requests
    anisotropic = searching and shows_anisotropy(task.layout, task.readings)
    view = None if settings.scene is None else _view(settings.scene, source, task, anisotropic)
    if not requests:
        return _fit_selected(task, source, view, anisotropic, seconds)
    task = task if view is None else _in_scene(task, view)
    tasks = [dataclasses.replace(task, requested=m.expression, terms=m.terms) for m in requests]
    return _best(tasks, source, view, seconds) if len(tasks) > 1 else _fit_one(tasks[0], source, view, None, seconds)


class _Request(NamedTuple):
    """A model that is to be fitted: its expression, and its terms with their defaults."""

    expression: str
    terms: tuple[Term, ...]


def _source(table: SubjectLike, settings: FitSettings) -> Table:
    """The table to fit, of the channels that the scene names, if it names some."""
    source = resolve_subject(table, blockwise=True).require_table()
    names = None if settings.scene is None else settings.scene.channels_of(source.channels.names)
    source = source.only(names) if names else source
    if (reason := why_no_radiances(source.channels.names)) is not None:
        raise GonioError(f"{source.name or 'the table'}: {reason}")
    return source


def _requests(model: str | list[str] | None, table: Table) -> list[_Request]:
    """The models to fit to a table; none where one is to be selected."""
    expressions = [_at_wavelengths(m, table) for m in ([model] if isinstance(model, str) else model or [])]
    return [_Request(m, with_defaults(parse(m))) for m in expressions]


def _at_wavelengths(expression: str, table: Table) -> str:
    """The expression with the wavelengths of the table's channels, where a model takes one that was not mentioned."""
    terms = parse(expression)
    complete = with_wavelengths(terms, table.channels.wavelengths_nm)
    return expression if complete == terms else terms_to_expression(complete)


def _task(table: Table, settings: FitSettings, models: list[tuple[Term, ...]]) -> FitTask:
    """The readings of a table with their loss and weights, as yet without a model; `models` are those to come."""
    readings = _readings(table, settings)
    if not readings.count:
        limit = settings.theta_max
        below = f" with both polar angles below {np.degrees(limit):g}°; raise --theta-max." if limit else "."
        raise GonioError(f"{table.name or 'The table'} has no valid reading{below}")
    counts = count_readings(table, readings)
    readings, counts["copies"] = _without_copies(readings, table, settings, models)
    readings = dataclasses.replace(readings, half_angles=half_angles_of(table))
    loss, sigma = _loss(settings, readings)
    if settings.weight is not None:
        cells = readings.by_cell(functools.partial(cell_weights, settings.weight, table.layout))
        times = readings.cell_weight
        readings = dataclasses.replace(readings, cell_weight=cells if times is None else cells * times)
    return FitTask(
        "", (), readings, loss, sigma, settings.weight, table.channels, table.layout, table.name, counts, settings
    )


def _readings(table: Table, settings: FitSettings) -> Readings:
    """The readings of a table; those of a large one stay in it where a fit goes through them once or twice."""
    often = settings.relative_noise is not None or settings.robust is not None or settings.bootstrap
    averaged = any(half_angles_of(table)) or sheet_of(table) is not None
    if settings.samples is None and settings.scene is None and not often and not averaged:
        stored = stored_readings(table, settings.theta_max)
        if stored is not None:
            return stored
    return readings_of(table, settings.samples, settings.theta_max, settings.seed)


def _without_copies(
    readings: Readings, table: Table, settings: FitSettings, models: list[tuple[Term, ...]]
) -> tuple[Readings, int]:
    """The readings that repeat no others, and how many did.

    All of them for a scene or patches, which weigh each, and of a simulation without noise, which none can share.
    """
    instrument = table.provenance.get("instrument")
    noisy = readings.noisy
    exact = not noisy and (instrument == IDEAL or isinstance(instrument, dict))
    if exact or settings.scene is not None or sheet_of(table) is not None:
        return readings, 0
    # A selection tries reciprocal lobes, and brushed ones where the light came from several azimuths.
    selected = Symmetry(not models and not shows_anisotropy(table.layout, readings), True)
    distinct = distinct_readings(readings, symmetry_of(models, table.channels) if models else selected)
    if distinct is None:
        return readings, 0
    known = _usual_loss(settings, noisy) == "sigma"
    return weighted_as_read(distinct, known), readings.count - distinct.readings.count


def _usual_loss(settings: FitSettings, has_uncertainty: bool) -> str:
    if settings.relative_noise is not None:
        return "sigma"
    return settings.loss or ("sigma" if has_uncertainty else "cbrt")


def _loss(settings: FitSettings, readings: Readings) -> tuple[str, np.ndarray | None]:
    """The loss, and the standard uncertainties (n, C) that it weighs with."""
    sigma = sigma_of(readings) if settings.relative_noise is None and settings.loss in (None, "sigma") else None
    loss = _usual_loss(settings, sigma is not None)
    if loss == "sigma" and sigma is None and settings.relative_noise is None:
        raise GonioError(NO_UNCERTAINTY)
    return loss, sigma


def _in_scene(task: FitTask, view: SceneView) -> FitTask:
    """The task on the readings of a scene, weighted by their effect on its radiance."""
    readings = dataclasses.replace(task.readings, cell_weight=None).part(view.cells)
    loss, sigma = ("linear", None) if task.settings.loss is None else _loss(task.settings, readings)
    readings = dataclasses.replace(readings, cell_weight=view.weight)
    return dataclasses.replace(task, readings=readings, loss=loss, sigma=sigma, weight="scene")


def _view(scene: Scene, table: Table, task: FitTask, anisotropic: bool) -> SceneView:
    """What a scene sees of the readings. Raises GonioError where the table lacks what it looks at."""
    scene.require_sides(table.sides, table.name or "the table")
    return view_of(scene, task.readings, anisotropic, index_of(table))


def _fit_selected(
    task: FitTask, table: Table, view: SceneView | None, anisotropic: bool, seconds: dict[str, float]
) -> FitResult:
    """A fit of the model that the readings ask for, with those that were tried as alternatives."""
    began = time.perf_counter()
    patches = Patches.of(table, task) if view is None else None
    selection = selected_model(task, anisotropic, view, patches)
    seconds = {**seconds, "select": time.perf_counter() - began}
    task = task if view is None else _in_scene(task, view)
    settings = dataclasses.replace(task.settings, starts=min(task.settings.starts, SELECTED_STARTS))
    task = dataclasses.replace(task, requested=selection.expression, terms=selection.terms, settings=settings)
    result = _fit_one(task, table, view, selection, seconds)
    return dataclasses.replace(result, alternatives=selection.rows())


def _best(tasks: list[FitTask], table: Table, view: SceneView | None, seconds: dict[str, float]) -> FitResult:
    """The result of the lowest BIC, converged ones first, with all of them as alternatives."""
    results: list[FitResult] = []
    refused: list[dict[str, Any]] = []
    for task in tasks:
        try:
            results.append(_fit_one(task, table, view, None, seconds))
        except GonioError as error:
            refused.append({"model": task.requested, "refused": str(error)})
    if not results:
        raise GonioError(refused[0]["refused"])
    ranked = sorted(results, key=lambda r: (not r.converged, r.bic))
    return dataclasses.replace(ranked[0], alternatives=[_alternative(r, ranked[0].bic) for r in ranked] + refused)


def _fit_one(
    task: FitTask, table: Table, view: SceneView | None, selection: Selection | None, seconds: dict[str, float]
) -> FitResult:
    began = time.perf_counter()
    patches = Patches.of(table, task) if view is None else None
    optima, task, notes = fit_at_middles(task, table) if patches is None else fit_patches(task, patches)
    r = assemble_result(task, optima, {**seconds, "fit": time.perf_counter() - began})
    r.notes[:0] = notes
    r.notes.extend([*_copies_note(task.counts), *table.provenance.get("warnings", [])])
    r.notes.extend([*aperture_notes(r.apertures), *wide_notes(table), *azimuth_notes(table, r.brdf)])
    r.notes.extend(polarisation_notes(table.channels.names))
    if rows := common_errors(table, optima, [p for p in r.parameters if p.status != "fixed"]):
        r = dataclasses.replace(r, common_errors=rows)
        r.notes.extend([] if rows[0]["stated"] is not None else [common_error_note(rows)])
    if view is not None:
        promised = promise(table, r.brdf, view.scene, determined=not r.undetermined)
        note = view.note(r.brdf, task.readings, selection and selection.scene)
        r.notes[:0] = [f"{note}; {promised.sentence()}"]
        r = dataclasses.replace(r, scene=promised.to_dict())
    verdict = "converged" if r.converged else f"NOT converged ({r.reason})"
    task.settings.log(
        f"{task.requested}: {verdict}, relative rms {r.metrics['relative_rms']:.3g}, BIC {r.bic:.6g}, "
        f"{r.starts_agreed} of {r.starts} starts agree, {r.seconds['fit']:.2f} s"
    )
    return r


def _copies_note(counts: dict[str, int]) -> list[str]:
    """A sentence on readings that repeat others, if there are some."""
    copies = counts["copies"]
    return [
        f"{copies} of {counts['used']} readings repeat others (the same directions, or turned, mirrored or exchanged "
        "ones, with equal values): they count once in uncertainties and tests"
    ] * (copies > 0)


def _alternative(r: FitResult, best: float) -> dict[str, Any]:
    return {
        "model": r.requested, "spelling": r.expression, "bic": r.bic, "bic_above_best": r.bic - best,
        "free": len(r.free_names), "converged": r.converged, "relative_rms": r.metrics["relative_rms"],
        "log_rms": r.metrics["log_rms"], "seconds": r.seconds["fit"],
    }  # fmt: skip
