"""From a table to a model: the one public function, `fit`."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from gonio.data.scene import Scene, load_scene
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Table
from gonio.fitting.fit_model import Options, fit_one, prepare
from gonio.fitting.problem.cell_measure import measure_of
from gonio.fitting.problem.counting import counted
from gonio.fitting.problem.losses import LOSSES
from gonio.fitting.problem.parameterisation import with_defaults
from gonio.fitting.problem.readings import Readings, readings_of, sigma_of
from gonio.fitting.result import FitResult
from gonio.fitting.solver.robust_weights import require_kind
from gonio.fitting.uncertainty.bootstrap import require
from gonio.models.errors import GonioError, nearest
from gonio.models.evaluation import evaluate
from gonio.models.expression.parser import parse

WIDENS = 0.02  # aperture half-angle over alpha, from which on the averaging shows in a fit


def fit(
    table: SubjectLike,
    model: str | list[str] | None = None,
    *,
    loss: str | None = None,
    theta_max: float | None = None,
    weight: str | None = None,
    relative_noise: float | None = None,
    robust: str | bool | None = None,
    bootstrap: int = 0,
    bootstrap_kind: str = "residuals",
    per_channel: bool = False,
    samples: int | None = None,
    starts: int = 8,
    scene: str | Scene | None = None,
    seed: int = 0,
    say: Callable[[str], None] = lambda line: None,
) -> FitResult:
    """Fit a spelled model to a table; of several, the one of the lowest BIC; of none (None), what the data ask for.

    That one grows from Lambert: BIC and held-out directions must both ask for a larger model, or the smaller stays
    (`gonio.fitting.selection.stepwise`); `alternatives` of the result says what was tried.

    What is free: an omitted shape parameter, or ``name=?``; ``name~v`` from that start; every lobe's scale unless it is
    written (``1 * ggx(...)``); an omitted Fresnel parameter means F = 1. Over channels, albedos and scales are free in
    each, shapes are shared; `per_channel` fits every channel by itself.

    `loss`: sigma, linear, cbrt, log or log1p; without one, sigma where the table has standard uncertainties, else cbrt.
    `relative_noise`: σ is this share of the model's own f, reweighted until it settles. `theta_max`: radians; readings
    beyond it, on either side, are left out. `weight`: solid-angle, cosine, projected-solid-angle or none. `samples`: at
    most so many cells, drawn by `seed`. `starts`: random starts beside those from the data. `robust`: tukey (or True),
    student or soft-l1: readings far off count less. `bootstrap`: so many refits to readings drawn again in blocks of
    neighbouring directions, for intervals that assume nothing of the noise; `bootstrap_kind`: residuals or pairs. `say`
    hears a line for each model tried. `scene`: a scene, its file or the name of a shipped one; the readings nearest to
    what it sees are fitted, weighed by what they do to its radiance (loss linear, unless one is named), the error there
    is among the notes, and without a model the cheapest one within its tolerance is taken.

    Raises GonioError for an unknown model, loss or weight, and for a table with too few readings for the model.
    """
    table = resolve_subject(table).require_table()
    asked = [model] if isinstance(model, str) else list(model or [])
    parsed = [with_defaults(parse(m)) for m in asked]
    if scene is not None:
        from gonio.fitting.selection.automatic import chosen_for_scene, scene_words, turned
        from gonio.fitting.selection.scene_selection import judged, seen

        scene = load_scene(scene)
        if weight is not None:
            raise GonioError(f"A scene weighs readings itself and excludes the weight '{weight}'; give one of them.")
        if names := scene.channels_of(table.channels.names):
            table = table.only(names)
    began = time.perf_counter()
    if parsed:
        prepare(parsed[0], _likely(loss, table, relative_noise), len(table.channels), per_channel)
    readings = readings_of(table, samples, theta_max, seed)
    if not readings.count:
        raise GonioError(
            f"{table.name or 'The table'} has no valid reading"
            + (f" with both polar angles below {np.degrees(theta_max):g}°; raise --theta-max." if theta_max else ".")
        )
    said_loss = loss
    loss, sigma = _loss(loss, readings, relative_noise)
    if weight is not None:
        readings = dataclasses.replace(readings, measure=measure_of(weight, table.layout, readings.wi, readings.wo))
    read_seconds = time.perf_counter() - began
    counts, look = counted(table, readings), None
    if scene is not None:
        look = seen(scene, readings, turned(table.layout, readings))
    require(bootstrap, bootstrap_kind)
    robust = require_kind("tukey" if robust is True else robust) if robust else None
    choice = None
    if not asked:
        from gonio.fitting.selection.automatic import chosen_model

        began = time.perf_counter()
        of = (table.layout, readings, loss, sigma)
        found = chosen_model(*of, seed, say) if look is None else chosen_for_scene(*of, look, seed, say)
        text, terms, choice = found
        asked, parsed, select_seconds = [text], [terms], time.perf_counter() - began
    if look is not None:
        readings = dataclasses.replace(readings, measure=None).part(look.cells)
        readings = dataclasses.replace(readings, measure=look.weight)
        loss, sigma = ("linear", None) if said_loss is None else _loss(said_loss, readings, relative_noise)
        weight = "scene"
    options = Options(
        loss, sigma, relative_noise, starts, seed, theta_max, weight, table.name, robust, bootstrap, bootstrap_kind,
        counts, table.layout,
    )  # fmt: skip
    results, refused = [], []
    for text, terms in zip(asked, parsed, strict=True):
        try:
            result = fit_one(text, terms, readings, table.channels, options, per_channel)
        except GonioError as error:
            if len(asked) == 1:
                raise
            refused.append({"model": text, "refused": str(error)})
            continue
        result.seconds["read"] = read_seconds
        result.notes.extend(_aperture_notes(table, result))
        if look is not None:
            f = np.asarray(evaluate(result.brdf, readings.wi, readings.wo)).reshape(readings.f.shape[0], -1)
            errors = judged(look, np.broadcast_to(f, readings.f.shape), readings)
            result.notes.insert(0, choice.words(look, *errors) if choice else scene_words(look, *errors))
        results.append(result)
        say(f"{text}: {_line(result)}")
    if choice is not None:
        results[0].seconds["select"] = select_seconds
        rows = choice.rows() if look is None else choice.rows(scene.tolerance)
        return dataclasses.replace(results[0], alternatives=rows)
    if not results:
        raise GonioError(refused[0]["refused"])
    ranked = sorted(results, key=lambda r: (not r.converged, r.bic))
    table_of = [_alternative(r, ranked[0].bic) for r in ranked] + refused
    return dataclasses.replace(ranked[0], alternatives=table_of if len(asked) > 1 else [])


def _likely(loss: str | None, table: Table, relative_noise: float | None) -> str:
    """The loss that `_loss` will most likely give, as long as no reading has been looked at."""
    if loss is not None and relative_noise is None:
        return loss
    return "cbrt" if relative_noise is None and table.u_f is None else "sigma"


def _loss(loss: str | None, readings: Readings, relative_noise: float | None) -> tuple[str, np.ndarray | None]:
    if relative_noise is not None:
        if loss not in (None, "sigma"):
            raise GonioError(
                f"relative_noise weighs by the noise itself and excludes the loss '{loss}'; give one of them."
            )
        if not 0 < relative_noise < 1:
            raise GonioError(
                f"A relative noise of {relative_noise:g} came; expected a share between 0 and 1, such as 0.05."
            )
        return "sigma", None
    if loss is not None and loss not in LOSSES:
        raise GonioError(f"Unknown loss '{loss}'; {nearest(loss, LOSSES)}")
    sigma = sigma_of(readings) if loss in (None, "sigma") else None
    if loss is None:
        loss = "cbrt" if sigma is None else "sigma"
    if loss == "sigma" and sigma is None:
        raise GonioError(
            "The loss 'sigma' needs standard uncertainties above 0, and this table has none; choose cbrt, log or log1p."
        )
    return loss, sigma


def _aperture_notes(table: Table, r: FitResult) -> list[str]:
    """A word on lobes that the apertures widen: the model is compared at the centres of what was averaged."""
    solid_angle = max(table.source_solid_angle or 0.0, table.receiver_solid_angle or 0.0)
    half_angle = np.sqrt(solid_angle / np.pi)
    widths = [p for p in r.parameters if ".alpha" in p.name and half_angle > WIDENS * p.value]
    if not widths:
        return []
    names = ", ".join(p.label for p in widths)
    return [
        f"a reading is an average over apertures of half-angle up to {np.degrees(half_angle):.2g}°, and the model is "
        f"compared at their centres: {names} may come out too wide"
    ]


def _line(r: FitResult) -> str:
    verdict = "converged" if r.converged else f"NOT converged ({r.reason})"
    return (
        f"{verdict}, relative rms {r.metrics['relative_rms']:.3g}, BIC {r.bic:.6g}, "
        f"{r.starts_agreed} of {r.starts} starts agree, {r.seconds['fit']:.2f} s"
    )


def _alternative(r: FitResult, best: float) -> dict:
    return {
        "model": r.asked,
        "spelling": r.expression,
        "bic": r.bic,
        "bic_above_best": r.bic - best,
        "free": len(r.free_names),
        "converged": r.converged,
        "relative_rms": r.metrics["relative_rms"],
        "log_rms": r.metrics["log_rms"],
        "seconds": r.seconds["fit"],
    }
