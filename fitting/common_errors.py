"""Errors that all readings share: how far they move a fit's numbers, whose standard uncertainties leave them out.

A calibration factor changes f by e f, a dark signal by e/(π cos θi), both with a share e of the same sign everywhere: a
model follows them, and no residual shows them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gonio.data.plausibility.correlated_uncertainty import correlated_uncertainty
from gonio.data.stated import TERMS, StatedUncertainty, stated_uncertainties
from gonio.data.table import Table
from gonio.fitting.drift import drift
from gonio.fitting.judgement import COMMON, common_error_words
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import evenly_spaced, rows_of, transform_slope, transformed, uses_cosine
from gonio.fitting.solver.disc_choice import step_towards
from gonio.fitting.uncertainty.optimum import Optimum, ParameterEstimate
from gonio.models.errors import GonioError

NOTEWORTHY = 0.5
"""Standard uncertainties of a number that a stated error moves it by, from which on it is named."""
USUAL = {"gain": 0.01, "dark": 0.001}
"""What good instruments reach, as a share of a white diffuser's signal: what nothing states may be as large."""
MOST_COMPARED = 1 << 14
"""Readings that are looked at; of more, evenly spaced ones."""


def common_errors(table: Table, optima: Sequence[Optimum], free: Sequence[ParameterEstimate]) -> list[dict[str, Any]]:
    """What the standard uncertainties of a fit leave out although the readings share it, the worst first.

    Args:
        table: what was fitted; its provenance states the uncertainties of a simulated instrument, and of others'
            readings the scatter shows how much of what they store is shared.
        optima: of all channels, or of each.
        free: the free numbers of all of them.

    Returns:
        For each term `name`, `meaning`, `stated` (a share, or None where nothing states it), `number` that it moves
        most, `equal`: the share that moves this by one standard uncertainty, and `fitted`: that `--nuisance` takes it
        in. Nothing where all is known exactly.
    """
    shared = correlated_uncertainty(table).relative
    if any((e.exact and not shared) or not e.converged for e in optima):
        return []
    rows = left_out(table.provenance, lambda acts: _moves(optima, free, acts), shared)
    return drift(optima, free) + [row | {"fitted": True} for row in rows]


def left_out(
    provenance: Mapping[str, Any],
    moves_by: Callable[[Sequence[str]], Mapping[str, tuple[float, str]]],
    shared: float = 0.0,
) -> list[dict[str, Any]]:
    """The same of anything that was fitted.

    Args:
        provenance: of the readings.
        moves_by: by "factor" and "offset" how many standard uncertainties it moves a number at most, for each unit of
            its share, and the label of this number.
        shared: what readings share of the uncertainties that they store, relative; 0 where they scatter as stated.
    """
    stated, rows = _stated(provenance), []
    stated |= {"gain": shared} if shared else {}
    moves = moves_by(sorted({TERMS[name].acts for name in stated}))
    for name, size in stated.items():
        moved, label = moves[TERMS[name].acts]
        if moved * (USUAL[name] if size is None else size) > (1.0 if size is None else NOTEWORTHY):
            meaning = COMMON if shared and name == "gain" else TERMS[name].meaning
            rows.append({"name": name, "meaning": meaning, "stated": size, "number": label, "equal": 1.0 / moved})
    # What is stated is a fault of the fit, however little it is beside what nothing states.
    return sorted(
        rows, key=lambda row: (row["stated"] is None, row["equal"] / (row["stated"] or USUAL.get(row["name"], 1.0)))
    )


def common_error_note(rows: Sequence[Mapping[str, Any]]) -> str:
    """What to do about terms that nothing states; nothing where the worst is known."""
    if not rows or rows[0].get("stated") is not None:
        return ""
    rows = [row for row in rows if row["name"] in USUAL]
    sizes = ", ".join(f"{row['name']}={100 * USUAL[row['name']]:g} %" for row in rows)
    names = ",".join(row["name"] for row in rows)
    return (
        f"{common_error_words(rows)}; give how well they are known, as in --uncertainty '{sizes}', to --nuisance "
        f"{names} where readings have u_f, or to gonio quantities --budget --fit"
    )


def _stated(provenance: Mapping[str, Any]) -> dict[str, float | None]:
    """Standard uncertainties, as shares, of factors and offsets; None of what nothing states."""
    instrument = provenance.get("instrument")
    if instrument == "ideal":
        return {}
    if not isinstance(instrument, dict):
        return dict.fromkeys(USUAL, None)
    try:
        known: dict[str, StatedUncertainty] = stated_uncertainties(instrument.get("uncertainty", {}))
    except (GonioError, AttributeError):
        known = {}
    calibration = instrument.get("calibration")
    usual = {"gain": float(calibration)} if isinstance(calibration, int | float) else {}
    given = {name: s.standard for name, s in known.items() if TERMS[name].acts in ("factor", "offset")}
    return {name: size for name, size in (usual | given).items() if math.isfinite(size) and size > 0}


def _moves(
    optima: Sequence[Optimum], free: Sequence[ParameterEstimate], acts: Sequence[str]
) -> dict[str, tuple[float, str]]:
    """By how many standard uncertainties each error moves a number at most, for each unit of its share, and which."""
    largest: dict[str, tuple[float, str]] = {}
    first = 0
    most = max(MOST_COMPARED // len(optima), 1)
    for e in optima:
        each = free[first : first + e.p.size]
        first += e.p.size
        for one, step in zip(acts, _steps(e, acts, most), strict=True):
            for p, d in zip(each, step, strict=True):
                if p.status == "determined" and 0 < p.standard_uncertainty < math.inf and math.isfinite(d):
                    moved = abs(float(d)) / p.standard_uncertainty
                    if moved > largest.get(one, (0.0, ""))[0]:
                        largest[one] = (moved, p.label)
    return {one: largest.get(one, (0.0, "")) for one in acts}


def _steps(e: Optimum, acts: Sequence[str], most: int) -> list[np.ndarray]:
    """How far the numbers (P,) move for each unit of the share of each error, to first order."""
    cells = evenly_spaced(e.model_f.shape[0], most)
    whole: FitProblem = e.problem
    f, cos_i = rows_of(e.model_f, cells), whole.readings.cos_i[cells, None]
    compared, cosine = f, 1.0
    if uses_cosine(whole.loss):
        compared, cosine = f * cos_i, cos_i
    with np.errstate(all="ignore"):
        slope = np.nan_to_num(transform_slope(whole.loss, compared, whole.floor) * cosine, posinf=0.0)
    compared, steps = transformed(whole.loss, compared, whole.floor), []
    problem = whole.compared_with(compared, cells)
    for one in acts:
        shift = f if one == "factor" else np.broadcast_to(1.0 / (math.pi * np.maximum(cos_i, 1e-6)), f.shape)
        steps.append(step_towards(problem.retargeted(compared + slope * shift), e.p))
    return steps
