"""A slow drift of the readings that no model follows: shown by their residuals long before these look like structure.

Readings that grow by a share from the first to the last leave residuals of which each is far below the noise. Their sum
along the drift, less what the model takes of it, tells the drift itself (a matched filter), and so how far it has moved
the numbers.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.problem.readings import evenly_spaced, rows_of, transform_slope, transformed, uses_cosine
from gonio.fitting.residuals.noise_tests import CLIP, NEGLIGIBLE, channel_effect
from gonio.fitting.solver.disc_choice import step_towards
from gonio.fitting.uncertainty.optimum import Optimum, ParameterEstimate

MEANING = "drift that the residuals show {along}"
ORDERS = ("from the first reading to the last", "from the normal to the horizon of the detector")
SURE = 5.0
"""Standard uncertainties of a drift from which on it is none of chance."""
MOST_COMPARED = 1 << 16
"""Readings that are looked at; of more, evenly spaced ones."""
FEWEST = 50
CHANCE = 3.0
"""Standard deviations of the correlation of neighbours in noise."""
EXPLAINED = 0.5
"""Correlation of neighbours that may be left, of what it is with the drift: of more the model is to blame."""
SCREENED = 2.0
"""Standard deviations of its noise that the sum along a drift has at least, where a model takes 84 % of it or less."""
SMALL = 1e-3
"""Relative drift by which the model's answer is taken to first order."""


class _Residuals(NamedTuple):
    """What is compared of the readings looked at, each (n, C), in the loss's own terms."""

    problem: FitProblem
    """Of these readings; its targets are the model's values."""
    slope: np.ndarray
    """Of the compared values by a relative change of f."""
    weighted: np.ndarray
    places: tuple[np.ndarray, np.ndarray]
    """Of the readings in `ORDERS`, (n,), from -1/2 to 1/2."""
    noise: float
    """Variance of the residuals."""


def drift(optima: Sequence[Optimum], free: Sequence[ParameterEstimate]) -> list[dict[str, Any]]:
    """The drift that moves a number of a fit most, as a row of `common_errors`; none where no residual shows one.

    Args:
        optima: of all channels, or of each.
        free: the free numbers of all of them.
    """
    rows, first = [], 0
    for e in optima:
        each = free[first : first + e.p.size]
        first += e.p.size
        if e.exact or not e.converged or (compared := _compared(e)) is None:
            continue
        for place, along in zip(compared.places, ORDERS, strict=True):
            amount, step = _amount(compared, place, e.p)
            moved, label = _moved(each, amount * step)
            if moved > 1.0:
                share = abs(amount) * SMALL
                row = {"name": "drift", "meaning": MEANING.format(along=along), "stated": share, "number": label}
                rows.append((moved, row | {"equal": share / moved}))
    return [max(rows, key=lambda r: r[0])[1]] if rows else []


def _compared(e: Optimum) -> _Residuals | None:
    """What a fit compares, and how it differs; None of too few readings, or all in one direction."""
    cells = evenly_spaced(e.model_f.shape[0], MOST_COMPARED)
    whole: FitProblem = e.problem
    f, cos_i = rows_of(e.model_f, cells), whole.readings.cos_i[cells, None]
    compared, cosine = (f * cos_i, cos_i) if uses_cosine(whole.loss) else (f, 1.0)
    with np.errstate(all="ignore"):
        slope = np.nan_to_num(transform_slope(whole.loss, compared, whole.floor) * cosine * f, posinf=0.0)
    compared = transformed(whole.loss, compared, whole.floor)
    problem = whole.compared_with(compared, cells)
    used, places = problem.weight > 0, (np.arange(cells.size), -np.asarray(whole.readings.wo.z[cells]))
    weighted = np.where(used, problem.weight * (rows_of(whole.targets, cells) - compared), 0.0)
    number, noise = np.count_nonzero(used), float(np.sum(weighted**2))
    if number < max(FEWEST, 2 * e.p.size) or not noise > 0 or not all(np.ptp(p) > 0 for p in places):
        return None
    order, polar = ((p - p.mean()) / np.ptp(p) for p in places)
    return _Residuals(problem, slope, weighted, (order, polar), noise / (number - e.p.size))


def _amount(c: _Residuals, place: np.ndarray, p: np.ndarray) -> tuple[float, np.ndarray]:
    """The drift along `place`, in units of `SMALL`, and how one unit moves the numbers (P,); 0 where none is sure."""
    shift = SMALL * c.slope * place[:, None]
    along = float(np.sum(c.problem.weight * shift * c.weighted))
    # Residuals are across all that the model takes: only how much of the drift it takes is left to compute.
    if abs(along) < SCREENED * math.sqrt(c.noise * float(np.sum((c.problem.weight * shift) ** 2))):
        return 0.0, np.zeros_like(p)
    step = step_towards(c.problem.retargeted(c.problem.targets + shift), p)
    taken = c.problem.compared(c.problem.values_near(p, step)) - c.problem.targets
    unexplained = c.problem.weight * (shift - taken)
    size = float(np.sum(unexplained**2))
    noise = c.noise * channel_effect(c.weighted / math.sqrt(c.noise), c.problem.weight > 0)
    amount = float(np.sum(unexplained * c.weighted)) / size if size > 0 else 0.0
    sure = amount**2 * size > SURE**2 * noise and _explains(c.weighted, c.weighted - amount * unexplained)
    return (amount if sure else 0.0), step


def _moved(each: Sequence[ParameterEstimate], moves: np.ndarray) -> tuple[float, str]:
    """The most standard uncertainties that a number moves by, and its label."""
    moved = [(0.0, "")]
    for p, d in zip(each, moves, strict=True):
        if p.status == "determined" and 0 < p.standard_uncertainty < math.inf and math.isfinite(d):
            moved.append((abs(float(d)) / p.standard_uncertainty, p.label))
    return max(moved)


def _explains(residual: np.ndarray, rest: np.ndarray) -> bool:
    """Whether most of what neighbouring residuals have alike goes with the drift."""
    before, after = _neighbours(residual), _neighbours(rest)
    return after <= max(NEGLIGIBLE + CHANCE / math.sqrt(residual.shape[0]), EXPLAINED * before)


def _neighbours(residual: np.ndarray) -> float:
    """Largest correlation of neighbouring residuals (n, C) of a channel, 0 where none counts."""
    largest = 0.0
    for t in residual.T:
        t = t[t != 0]
        if t.size >= FEWEST:
            t = np.clip(t / np.median(np.abs(t)), -CLIP, CLIP)
            largest = max(largest, float(np.mean(t[1:] * t[:-1]) / np.mean(t * t)))
    return largest
