"""Propagation of distributions by Monte Carlo [JCGM 101:2008], to see whether a linear budget holds.

Each draw puts errors of all sources into the readings at once, by the whole formula of a reading, and integrates and
fits them anew.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from gonio.data.table import Table
from gonio.metrology.budget import LEVEL, Budget
from gonio.metrology.effects import Readings
from gonio.metrology.fit_budget import FitBudget
from gonio.metrology.measurands import TableMeasurands
from gonio.metrology.sources import Noise, Sources
from gonio.metrology.table_budget import aperture_shift
from gonio.models.errors import GonioError
from gonio.models.special.scipy_functions import ndtri

FEWEST, MOST = 100, 1_000_000
TAIL = (1 - LEVEL) / 2
DENSITY = math.exp(-0.5 * float(ndtri(TAIL)) ** 2) / math.sqrt(2 * math.pi)
"""Of the standard normal distribution where the tail begins."""


@dataclasses.dataclass(frozen=True)
class Simulation:
    """What draws are made of: the quantities of a table, its readings, its sources of error, and a fit of it."""

    measurands: TableMeasurands
    readings: Readings
    sources: Sources
    fit: FitBudget | None

    def outcomes(self, budget: Budget, draws: int, seed: int) -> np.ndarray:
        """Changes of all quantities (draws, Q), by errors of all sources of the budget."""
        rng, acting = np.random.default_rng([seed, 0x6D63]), self.sources.acting
        sigma = _total(self.measurands.table, self.sources.noise, self.readings.cells)
        aperture = aperture_shift(self.measurands.table, self.readings)
        offset = aperture if isinstance(aperture, np.ndarray) and aperture.any() else np.zeros(1)
        base = self.measurands.base.values
        place = None if self.fit is None else self._place(self.fit)
        by_reading = {n.name for n in self.sources.noise}
        beside = [c for c in budget.contributions if not c.shared and c.name not in by_reading]
        rows = []
        for _ in range(draws):
            z = rng.standard_normal(len(acting))
            errors = {name: float(s.stated.errors(e)) for (name, s), e in zip(acting.items(), z, strict=True)}
            systematic = self.readings.change(errors)
            noise = sigma * rng.standard_normal(sigma.shape)
            shift = systematic + noise + rng.uniform(-1, 1) * offset
            row = [self.measurands.read_out(self.readings.moved(shift)).values - base]
            if self.fit is not None:
                row.append(self.fit.refitted((systematic + noise)[place]))
            u = rng.uniform(-1, 1, budget.size) * math.sqrt(3.0)
            normal = rng.standard_normal(budget.size)
            others = (c.values * (u if c.shape == "rectangular" else normal) for c in beside)
            rows.append(sum(others, np.concatenate(row)))
        return np.array(rows)

    def _place(self, fit: FitBudget) -> np.ndarray:
        if fit.cells is None:
            raise GonioError("the fit took a choice of the readings; Monte Carlo needs one of all of them")
        return np.searchsorted(self.readings.cells, fit.cells)


def simulated(simulation: Simulation, budget: Budget, draws: int, seed: int) -> dict[str, Any]:
    """What draws give of each quantity, beside the linear budget.

    Standard deviation, shift of the mean, 95.45 % interval of the change with equal tails, and whether the linear
    interval agrees with it: both ends to one significant digit of u [clause 8], and to twice what the draws scatter by.
    """
    changes = simulation.outcomes(budget, draws, seed)
    ends = np.quantile(changes, [TAIL, 1 - TAIL], axis=0)
    u = budget.standard
    with np.errstate(divide="ignore", invalid="ignore"):
        digit = 0.5 * 10.0 ** np.floor(np.log10(np.where(u > 0, u, 1.0)))
        off = np.max(np.abs(ends - budget.factor * u * np.array([[-1.0], [1.0]])), axis=0)
    scatter = changes.std(axis=0, ddof=1) * math.sqrt(TAIL * (1 - TAIL) / draws) / DENSITY
    return {
        "draws": draws, "seed": seed, "standard_uncertainty": changes.std(axis=0, ddof=1),
        "shift": changes.mean(axis=0), "interval_95.45_percent": ends.T,
        "linear_agrees": (off <= digit + 2 * scatter) & np.isfinite(u),
    }  # fmt: skip


def require_draws(draws: int) -> None:
    """Raises GonioError for a number of draws that tells nothing, or does not end."""
    if not FEWEST <= draws <= MOST:
        raise GonioError(f"{draws} draws of Monte Carlo came; give from {FEWEST} to {MOST:,}, such as 1000")


def _total(table: Table, noise: list[Noise], cells: np.ndarray) -> np.ndarray:
    """Standard uncertainties of the readings (n, C) by all parts of their noise."""
    size = (table.layout.size, -1)
    total = sum((part.u_f.reshape(size)[cells] ** 2 for part in noise), np.zeros((cells.size, len(table.channels))))
    return np.sqrt(np.nan_to_num(total))
