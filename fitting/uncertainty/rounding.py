"""Readings that were rounded to a step: what that moves the numbers of a fit by, beyond what noise does.

Where noise is smaller than the step, all readings of a smooth region are rounded the same way: their errors are no
noise, and no mean over them is better than one. A value v with noise of standard deviation σ, rounded to multiples of
q, is off by round(v) − v on average where σ is small, and the more noise the less: times exp(−2π²σ²/q²) [Widrow 1961].
"""

import dataclasses

import numpy as np

from gonio.fitting.problem.readings import AnyArray, Readings, rows_of
from gonio.fitting.solver.disc_choice import moved_by
from gonio.fitting.uncertainty.optimum import Optimum

FIRST, LOOKED_AT = 500, 1 << 14
"""Readings by which a step is looked for at first, and then; of more, a random choice."""
FEWEST_STEPS = 8
"""Different values below which their differences tell no step."""
COARSE = 1000.0
"""Steps in the median value up to which rounding may move a number."""
DIVISORS = 10
"""The smallest difference of values may be so many steps."""
WHOLE = 0.01
"""Steps by which a value may be off a multiple: what single precision leaves of values up to `COARSE` is less."""
DARK = 30.0
"""Steps up to which readings tell the noise beside the rounding."""
WORTH_A_WORD = 1.1
"""Factor of an uncertainty from which on it is said."""


def with_rounding(e: Optimum, noise_known: bool) -> tuple[Optimum, str | None]:
    """The optimum with uncertainties that hold what the rounding of its readings moves, and a note; else the same."""
    if e.exact or not e.p.size or not np.isfinite(e.cost):
        return e, None
    n, channels = e.readings.f.shape
    cells = np.arange(n) if n <= LOOKED_AT else np.sort(np.random.default_rng(0).integers(n, size=LOOKED_AT))
    readings = e.readings if n <= LOOKED_AT else e.readings.part(cells)
    steps = np.array([rounding_step(readings.channel(c)) for c in range(channels)])
    if not steps.any():
        return e, None
    problem = e.problem if n <= LOOKED_AT else e.problem.subset(cells)
    f, u = rows_of(e.model_f, cells), e.covariance.standard
    moved = moved_by(problem, e.p, f, _expected(readings, f, steps, noise_known))
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.sqrt(1.0 + np.nan_to_num(moved / u, posinf=0.0, neginf=0.0) ** 2)
    factor = np.where(e.active_bound, 1.0, factor)
    if factor.max() < WORTH_A_WORD:
        return e, None
    coarsest = float(steps.max())
    note = (
        f"the values are rounded to multiples of {coarsest:.3g} 1/sr, alike in neighbouring directions: that may move "
        f"a number by {np.sqrt(factor.max() ** 2 - 1):.2g} of the standard uncertainties of noise, and these hold it"
    )
    return dataclasses.replace(e, covariance=e.covariance.stretched(factor, e.domains, e.p)), note


def rounding_step(readings: Readings) -> float:
    """The step that all values of one channel are multiples of, 1/sr; 0 where there is none that matters."""
    f = np.abs(readings.f[readings.valid & (readings.f != 0)])
    # A few show most tables to have none.
    return _step_of(f) if f.size <= FIRST or _step_of(f[:: f.size // FIRST]) else 0.0


def _step_of(f: np.ndarray) -> float:
    """The step of values above 0; 0 where there is none that matters."""
    values = np.unique(f)
    if values.size < FEWEST_STEPS:
        return 0.0
    smallest = float(min(np.diff(values).min(), values[0]))
    middle = float(np.median(f))
    for divisor in range(1, DIVISORS + 1):
        step = smallest / divisor
        if middle > COARSE * step:
            return 0.0
        if np.all(np.abs(values / step - np.round(values / step)) < WHOLE):
            return step
    return 0.0


def _expected(readings: Readings, f: np.ndarray, steps: np.ndarray, noise_known: bool) -> np.ndarray:
    """Mean changes (n, C) of the model's values f by rounding to `steps` (C,), as far as noise leaves any."""
    change: AnyArray = np.zeros_like(f)
    for c in np.flatnonzero(steps):
        q, v = steps[c], f[:, c]
        dark = readings.valid[:, c] & (np.abs(v) < DARK * q)
        variance = np.mean((readings.f[dark, c] - v[dark]) ** 2) - q**2 / 12 if dark.any() else 0.0
        sigma2 = np.maximum(variance, 0.0)
        if noise_known:
            sigma2 = np.nan_to_num(np.asarray(readings.u_f[:, c], float)) ** 2
        change[:, c] = (np.round(v / q) * q - v) * np.exp(-2 * np.pi**2 * sigma2 / q**2)
    return change
