"""Readings that scatter otherwise than their stated uncertainties say: more where f is bright, less where it is dark.

Their χ² may be right all the same, and the covariance (JᵀJ)⁻¹ of stated noise is then wrong by as much as the readings
that tell of a number scatter more than the others. The covariance of the scatter itself [White 1980] needs no pattern.
"""

import dataclasses

import numpy as np

from gonio.fitting.problem.problem import weighted_residuals
from gonio.fitting.problem.readings import evenly_spaced, rows_of
from gonio.fitting.uncertainty.joint_covariance import JointEstimate
from gonio.fitting.uncertainty.optimum import Optimum

MOST_CELLS = 1 << 14
"""Of which the scatter is looked at; of more, a random choice."""
MOST_READINGS = 1 << 18
"""Of these cells; of more, evenly spaced channels."""
CLASS, CLASSES = 60, 16
"""Readings of one class of brightness, at least, and classes, at most."""
SURE = 4.0
"""Standard errors of normal noise by which the scatter of a class must be above what is stated."""
WORTH_A_WORD = 1.05
"""Factor of an uncertainty from which on it counts."""


def with_scatter_pattern(e: Optimum, seed: int) -> tuple[Optimum, str | None]:
    """The optimum of known noise with the uncertainties of its scatter where that is larger in a class of brightness.

    Only numbers that become less certain change; a note says by how much, and how far the scatter is off.
    """
    if e.exact or not e.p.size or not np.isfinite(e.cost) or (excess := _largest_excess(e, seed)) <= 1.0:
        return e, None
    made = e.problem.evaluate(e.p)
    estimate = JointEstimate(made.equations, made.scores, e.readings.count, e.domains, e.p, e.problem.order)
    known = e.covariance.standard
    scatter = estimate.covariance(~e.active_bound & np.isfinite(known)).standard
    with np.errstate(invalid="ignore"):
        factor = np.maximum(np.nan_to_num(scatter / known, nan=1.0), 1.0)
    if factor.max() < WORTH_A_WORD:
        return e, None
    note = (
        f"readings of like brightness scatter by up to {excess:.2g} times their stated uncertainties: the standard "
        f"uncertainties are of this scatter, up to {factor.max():.2g} times what is stated gives"
    )
    return dataclasses.replace(e, covariance=e.covariance.stretched(factor, e.domains, e.p)), note


def _largest_excess(e: Optimum, seed: int) -> float:
    """How many times their stated uncertainties readings of like brightness scatter, at most; 1 if none surely do."""
    n = e.model_f.shape[0]
    rng = np.random.default_rng([seed, 0x70617474])
    cells = np.sort(rng.integers(n, size=MOST_CELLS)) if n > MOST_CELLS else np.arange(n)
    channels = evenly_spaced(e.model_f.shape[1], max(1, MOST_READINGS // cells.size))
    readings, f = e.readings.part(cells).of_channels(channels), rows_of(e.model_f, cells)[:, channels]
    weight = rows_of(e.problem.weight, cells)[:, channels]
    used = weight > 0
    squares = weighted_residuals(readings, e.problem.loss, e.problem.floor, weight, f)[used] ** 2
    expected = max(1.0, float(squares.mean())) if squares.size else 1.0
    largest = 1.0
    for some in np.array_split(np.argsort(np.abs(f[used]), kind="stable"), max(1, min(CLASSES, squares.size // CLASS))):
        mean, number = float(squares[some].mean()), some.size
        if mean > expected * (1.0 + SURE * np.sqrt(2.0 / number)):
            largest = max(largest, float(np.sqrt(mean)))
    return largest
