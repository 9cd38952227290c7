"""Fitted candidates of a model selection, and their comparison."""

import dataclasses
from typing import Any

import numpy as np

from gonio.fitting.selection.candidate_model import SelectionData
from gonio.fitting.selection.criteria import improves_holdout
from gonio.fitting.selection.term_spec import Terms, expression_of

ROUNDING = 0.01  # χ² a reading below which only rounding is left


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A fitted candidate: free numbers, χ² in units of the noise, χ² by hold-out group, residuals, seconds."""

    terms: Terms
    p: np.ndarray
    chi2: float
    holdout: np.ndarray
    residual: np.ndarray
    relative_rms: float
    seconds: float

    @property
    def size(self) -> int:
        """Number of free numbers."""
        return self.p.size

    @property
    def expression(self) -> str:
        """The model as a user would write it."""
        return expression_of(self.terms)


@dataclasses.dataclass(frozen=True)
class SelectionResult:
    """The selected candidate, and all candidates in the order of fitting."""

    chosen: Candidate
    candidates: list[Candidate]
    dispersion: float  # variance of the residuals of the best fit, in units of the noise's; of known noise at least 1
    design_effect: float
    count: int  # of readings
    data: SelectionData
    refused: Candidate | None = None  # what would have been chosen, but reflects more than it receives

    def bic(self, c: Candidate) -> float:
        """Bayesian information criterion for the effective number of readings; lower is better [Schwarz 1978]."""
        price = float(np.log(max(self.count / self.design_effect, 2.0)))
        return max(c.chi2, self._rounding) / (self.dispersion * self.design_effect) + c.size * price

    def improves_holdout(self, small: Candidate, large: Candidate) -> bool:
        """Whether `large` predicts directions that neither has seen better than `small`."""
        return improves_holdout(self.held_out(small), self.held_out(large))

    def held_out(self, c: Candidate) -> np.ndarray:
        """χ² by hold-out group (G,), never below what rounding leaves."""
        return np.maximum(c.holdout, self._rounding / c.holdout.size)

    @property
    def _rounding(self) -> float:
        return ROUNDING * self.count

    def better(self, current: Candidate, others: list[Candidate]) -> Candidate | None:
        """The one of lowest BIC among those that both BIC and cross-validation prefer to the current one."""
        lower = [c for c in others if np.isfinite(c.chi2) and self.bic(c) < self.bic(current)]
        return min((c for c in lower if self.improves_holdout(current, c)), key=self.bic, default=None)

    def ranked(self) -> list[Candidate]:
        """All candidates, smallest models first."""
        return sorted(self.candidates, key=lambda c: (c.size, self.bic(c)))

    def rows(self) -> list[dict[str, Any]]:
        """The candidates as plain data, smallest models first."""
        return [self._row(c) for c in self.ranked()]

    def _row(self, c: Candidate) -> dict[str, Any]:
        best, bic = float(self.chosen.holdout.sum()), self.bic(c)
        return {
            "model": c.expression,
            "bic": bic,
            "bic_above_best": bic - self.bic(self.chosen),
            "held_out_above_best": float(np.sqrt(c.holdout.sum() / best)) - 1.0 if best > 0 else 0.0,
            "free": c.size,
            "converged": bool(np.isfinite(c.chi2)),
            "relative_rms": c.relative_rms,
            "seconds": c.seconds,
            "verdict": self._verdict(c),
        }

    def _verdict(self, c: Candidate) -> str:
        if c is self.chosen:
            return "chosen"
        if c is self.refused:
            return "refused: it reflects more than it receives"
        if c.size < self.chosen.size:
            return "leaves structure in the residuals"
        preferred_by = ["BIC"] if self.bic(c) < self.bic(self.chosen) else []
        if self.improves_holdout(self.chosen, c):
            preferred_by.append("held-out directions")
        if not preferred_by:
            return "not asked for"
        if len(preferred_by) == 1:
            return f"asked for by {preferred_by[0]} alone"
        return "asked for by BIC and held-out directions, but a smaller model predicts those better"
