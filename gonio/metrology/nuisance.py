"""Fits with nuisance numbers: errors of the instrument that are fitted beside the model, held by their uncertainties.

The rows of a fit get a column for each error e_j, in units of its standard uncertainty, and the sum of squares a term
e_j²: [J q; 0 1]. The numbers of the model are eliminated first, so that an error which they can follow, such as a gain,
keeps its prior and widens them.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import numpy as np

from gonio.data.stated import BOTH_TILTS, TERMS
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Table
from gonio.fitting.common_errors import common_error_note
from gonio.fitting.fit_table import fit
from gonio.fitting.options import FitOptions
from gonio.fitting.result import FitResult
from gonio.fitting.uncertainty.covariance import NORMAL_95, Covariance
from gonio.fitting.uncertainty.joint_covariance import JointCovariance, View
from gonio.fitting.uncertainty.optimum import ParameterEstimate
from gonio.instrument.instrument import SYSTEMATIC_TERMS, Instrument
from gonio.metrology.effects import Readings
from gonio.metrology.fit_budget import FitBudget, Sums, fit_errors, inverse_of
from gonio.metrology.sources import Source, Sources, sources_of
from gonio.models.errors import GonioError, nearest

ROUNDS, SETTLED = 12, 1e-2
"""Corrections of the readings, and the change of all errors, in the uncertainties left to them, at which they end."""

UNSETTLED = "nuisance: after {rounds} corrections an error still moves by {moved:.2g} of its standard uncertainty"


@dataclasses.dataclass(frozen=True)
class Step:
    """One step: errors (m,) in units of their uncertainties, their covariance, and how numbers follow them (P, m)."""

    errors: np.ndarray
    covariance: np.ndarray
    followed: np.ndarray


def fit_with_nuisance(
    table: SubjectLike,
    model: str | None,
    nuisance: Sequence[str],
    instrument: Instrument | None = None,
    uncertainty: Mapping[str, object] | None = None,
    **options: Unpack[FitOptions],
) -> FitResult:
    """A fit whose readings are corrected for errors of the instrument that are fitted with it.

    Args:
        table: with stored uncertainties, which the errors of the instrument are weighed against.
        model: as `gonio.fit` takes it.
        nuisance: names of terms, such as ["tilt", "theta_i", "gain", "dark"].
        instrument: the real one; its stated uncertainties hold the errors, before those that the table stores.
        uncertainty: stated uncertainties of single terms, before both.
        options: those of `gonio.fit`.

    Returns:
        The fit of the corrected readings; its uncertainties hold those of the errors, which `nuisance` lists.

    Raises:
        GonioError: a term that is unknown or of which nothing states an uncertainty, and readings of unknown noise.
    """
    source = resolve_subject(table).require_table()
    priors = _priors(sources_of(source, instrument, uncertainty or {}), nuisance)
    result = fit(source, model, **options)
    if result.loss != "sigma" or options.get("relative_noise") is not None:
        raise GonioError("nuisance numbers are weighed against the noise: this needs a table with uncertainties (u_f)")
    chosen, errors = Sources(priors, [], {}), np.zeros(len(priors))
    step = _step(errors, made := fit_errors(source, result, chosen), made.sums())
    moved = math.inf
    for _ in range(ROUNDS):
        corrected = _corrected(source, result, priors, step.errors)
        result = fit(corrected, result.requested, **{**options, "starts": 0})
        before = step.errors
        step = _step(before, made := fit_errors(corrected, result, chosen), made.sums())
        # What readings tell of an error may be far closer than what was stated of it.
        moved = float(np.max(np.abs(step.errors - before) / np.sqrt(np.diagonal(step.covariance))))
        if moved < SETTLED:
            break
    widened = _widened(result, priors, step)
    if moved >= SETTLED:
        widened.notes.append(UNSETTLED.format(rounds=ROUNDS, moved=moved))
    return widened


def _priors(sources: Sources, nuisance: Sequence[str]) -> dict[str, Source]:
    priors: dict[str, Source] = {}
    for given in nuisance:
        for name in ("tilt_x", "tilt_y") if given == BOTH_TILTS else (given,):
            if name not in SYSTEMATIC_TERMS:
                raise GonioError(
                    f"there is no nuisance number {given!r}; {nearest(given, [*SYSTEMATIC_TERMS, BOTH_TILTS])}"
                )
            if name not in sources.acting:
                raise GonioError(
                    f"nothing states the uncertainty of {name}, which holds it; give it, as in --uncertainty "
                    f"'{name}={'0.05 deg' if TERMS[name].acts == 'angle' else '0.5 %'}'"
                )
            priors[name] = sources.acting[name]
    return priors


def _step(errors: np.ndarray, made: FitBudget, sums: Sums) -> Step:
    """The errors after a step from these, by the extended normal equations."""
    p, total = made.prior.p.size, sums.total
    inverse = inverse_of(total[:p, :p], made.moving)
    followed = inverse @ total[:p, p:-1]
    covariance = np.linalg.inv(total[p:-1, p:-1] - total[p:-1, :p] @ followed + np.eye(errors.size))
    towards = total[p:-1, -1] - followed.T @ total[:p, -1] + errors
    return Step(errors - covariance @ towards, covariance, followed)


def _corrected(table: Table, result: FitResult, priors: Mapping[str, Source], errors: np.ndarray) -> Table:
    readings = Readings.of(table, result.brdf)
    sizes = {name: float(e) * s.stated.standard for (name, s), e in zip(priors.items(), errors, strict=True)}
    return readings.moved(readings.correction(sizes))


def _widened(result: FitResult, priors: Mapping[str, Source], step: Step) -> FitResult:
    """The result with the uncertainty of the errors in its own, and with the errors themselves."""
    matrix = result.covariance + step.followed @ step.covariance @ step.followed.T
    joint = result.uncertainty[0]
    index = np.arange(joint.size)
    spread = Covariance(matrix, joint.undetermined, [])
    view = View(None, index, np.linalg.pinv(np.nan_to_num(matrix), hermitian=True), spread)
    free = iter(np.sqrt(np.diagonal(matrix)))
    parameters = [p if p.status == "fixed" else _with(p, float(next(free))) for p in result.parameters]
    rows = [
        _row(s, e, math.sqrt(v))
        for s, e, v in zip(priors.values(), step.errors, np.diagonal(step.covariance), strict=True)
    ]
    notes = [f"nuisance: {row['sentence']}" for row in rows]
    covariance = [JointCovariance(joint.size, (view,), None)]
    left_out = [row for row in result.common_errors if row["name"] not in priors]
    kept = [n for n in result.notes if not (result.common_errors and n == common_error_note(result.common_errors))]
    if left_out and left_out[0]["stated"] is None:
        kept.append(common_error_note(left_out))
    return dataclasses.replace(
        result, parameters=parameters, uncertainty=covariance, nuisance=rows, notes=[*kept, *notes],
        common_errors=left_out,
    )  # fmt: skip


def _with(p: ParameterEstimate, u: float) -> ParameterEstimate:
    if p.status != "determined" or not math.isfinite(u):
        return p
    interval = max(p.low, p.value - NORMAL_95 * u), min(p.high, p.value + NORMAL_95 * u)
    return dataclasses.replace(p, standard_uncertainty=u, interval95=interval)


def _row(source: Source, error: float, spread: float) -> dict[str, Any]:
    stated, angle = source.stated, TERMS[source.stated.name].acts == "angle"
    scale, unit = (math.degrees(1.0), "°") if angle else (100.0, " %")
    value, u, prior = (float(x) * stated.standard * scale for x in (error, spread, 1.0))
    sentence = f"{TERMS[stated.name].meaning}: {value:.3g} ± {u:.2g}{unit} (stated ± {prior:.3g}{unit})"
    return {
        "name": stated.name, "value": value, "standard_uncertainty": u, "stated": prior, "unit": unit.strip(),
        "sentence": sentence,
    }  # fmt: skip
