"""Uncertainty budgets in the form of the GUM [JCGM 100:2008]: contributions, combined and expanded uncertainties."""

import dataclasses
import math
from typing import Any

import numpy as np

from gonio.models.special.scipy_functions import stdtrit

COVERAGE = 2.0
"""k of the expanded uncertainty: 95.45 % of a normal distribution."""
LEVEL = math.erf(COVERAGE / math.sqrt(2.0))


@dataclasses.dataclass(frozen=True)
class Contribution:
    """What one input contributes to the uncertainty of Q quantities.

    Attributes:
        name: of the input, such as "gain" or "counting".
        meaning: what it is.
        shared: the same error is in all readings, so that it moves all quantities together by `values` (signed, fully
            correlated); else its errors are independent from reading to reading.
        values: contributions u_i(y) = c_i u(x_i) to each quantity (Q,).
        standard: standard uncertainty u(x_i), in `unit`; None of what has another one in each reading.
        unit: of the input; "1" is a share.
        shape: its distribution.
        dof: its degrees of freedom.
        origin: where its uncertainty comes from: stated, stored in the table, or estimated.
    """

    name: str
    meaning: str
    shared: bool
    values: np.ndarray
    standard: float | None = None
    unit: str = "1"
    shape: str = "normal"
    dof: float = math.inf
    origin: str = "stated"

    @property
    def sensitivities(self) -> np.ndarray | None:
        """c_i = ∂y/∂x_i of each quantity (Q,), in the quantity's unit over the input's."""
        return self.values / self.standard if self.standard else None

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data."""
        sensitivities = self.sensitivities
        return {
            "name": self.name, "meaning": self.meaning, "correlated": self.shared, "origin": self.origin,
            "standard_uncertainty": self.standard, "unit": self.unit, "distribution": self.shape,
            "degrees_of_freedom": self.dof, "contributions": self.values,
            "sensitivities": None if sensitivities is None else sensitivities,
        }  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Budget:
    """The contributions to the uncertainty of Q quantities, and what is not among them.

    Attributes:
        contributions: see `Contribution`.
        missing: why an input is not known, by its name.
        unbounded: (Q,) whether what lies between the readings leaves a quantity without a bound.
        simulated: Monte Carlo of the same inputs (see `gonio.metrology.monte_carlo`), or None.
    """

    contributions: list[Contribution]
    missing: dict[str, str]
    unbounded: np.ndarray
    simulated: dict[str, Any] | None = None

    @property
    def size(self) -> int:
        """Number of quantities."""
        return self.unbounded.size

    @property
    def standard(self) -> np.ndarray:
        """Combined standard uncertainties (Q,) of what is known [eq. 10]; infinite without a bound."""
        total = np.sqrt(sum((c.values**2 for c in self.contributions), np.zeros(self.size)))
        return np.where(self.unbounded, np.inf, total)

    @property
    def systematic(self) -> np.ndarray:
        """The part of it (Q,) that all readings share, so that more readings do not make it smaller."""
        return np.sqrt(sum((c.values**2 for c in self.contributions if c.shared), np.zeros(self.size)))

    @property
    def dof(self) -> np.ndarray:
        """Effective degrees of freedom (Q,) [Welch & Satterthwaite, eq. G.2b]."""
        finite = [c for c in self.contributions if math.isfinite(c.dof)]
        lost = sum((c.values**4 / c.dof for c in finite), np.zeros(self.size))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(lost > 0, np.where(self.unbounded, 0.0, self.standard) ** 4 / lost, np.inf)

    @property
    def expanded(self) -> np.ndarray:
        """Expanded uncertainties (Q,), k = 2."""
        return COVERAGE * self.standard

    @property
    def factor(self) -> np.ndarray:
        """The k (Q,) of 95.45 %: Student's, with the effective degrees of freedom truncated [G.6.4]."""
        dof = np.maximum(np.floor(self.dof), 1.0)
        return np.where(np.isfinite(dof), stdtrit(np.minimum(dof, 1e9), (1 + LEVEL) / 2), COVERAGE)

    def covariance(self) -> np.ndarray:
        """Covariance (Q, Q) by the errors that readings share; the others are on its diagonal alone."""
        known = [c for c in self.contributions if c.shared]
        matrix = sum((np.outer(c.values, c.values) for c in known), np.zeros((self.size, self.size)))
        alone = sum((c.values**2 for c in self.contributions if not c.shared), np.zeros(self.size))
        return matrix + np.diag(alone)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data; lists are in the order of the quantities."""
        return {
            "k": COVERAGE,
            "complete": not self.missing,
            "not_known": self.missing,
            "standard_uncertainty": self.standard,
            "shared_by_all_readings": self.systematic,
            "effective_degrees_of_freedom": self.dof,
            "expanded_uncertainty": self.expanded,
            "k_of_95.45_percent": self.factor,
            "contributions": [c.to_dict() for c in self.contributions],
            "monte_carlo": self.simulated,
        }


def joined(first: Budget, second: Budget) -> Budget:
    """The budget of the quantities of both, one after the other; inputs of one name are one input."""
    sizes = first.size, second.size
    names = dict.fromkeys(c.name for b in (first, second) for c in b.contributions)
    rows = []
    for name in names:
        each = [next((c for c in b.contributions if c.name == name), None) for b in (first, second)]
        known = each[0] or each[1]
        assert known is not None
        values = [np.zeros(n) if c is None else c.values for c, n in zip(each, sizes, strict=True)]
        rows.append(dataclasses.replace(known, values=np.concatenate(values)))
    missing = first.missing | second.missing
    return Budget(rows, missing, np.concatenate([first.unbounded, second.unbounded]))
