"""What a selection tried, and how the tried are judged beside each other."""

import dataclasses

import numpy as np

from gonio.fitting.selection import criteria
from gonio.fitting.selection.candidate_model import Part, Scenery


@dataclasses.dataclass(frozen=True)
class Tried:
    """A sketch that was fitted: its numbers, Σr² in units of the noise, Σr² by held-out group, residuals, seconds."""

    parts: tuple[Part, ...]
    p: np.ndarray
    chi2: float
    held: np.ndarray
    residual: np.ndarray
    relative_rms: float
    seconds: float

    @property
    def size(self) -> int:
        """Free numbers."""
        return self.p.size

    @property
    def spelled(self) -> str:
        """The model as a user would ask for it."""
        return " + ".join(part.spelled() for part in self.parts)


@dataclasses.dataclass(frozen=True)
class Choice:
    """The chosen model, and all that was tried, in the order of trying."""

    chosen: Tried
    tried: list[Tried]
    unit: float  # variance of the residuals of the best fit, in units of the noise's, but at least 1
    worth: float  # readings that are worth one independent reading
    count: int
    scenery: Scenery  # the readings that were looked at

    @property
    def channels(self) -> int:
        """How many of the table's channels were looked at."""
        return self.scenery.target.shape[1]

    def bic(self, t: Tried) -> float:
        """Schwarz's criterion of the independent readings there are; lower is better [Schwarz 1978]."""
        return bic(t, self.unit, self.worth, self.count)

    def gain(self, small: Tried, large: Tried) -> criteria.Gain:
        """What `large` gains over `small` on directions that neither has seen."""
        return criteria.gain(small.held / self.unit, large.held / self.unit)

    def rows(self) -> list[dict]:
        """What was tried as plain data, smallest models first."""
        return [self._row(t) for t in sorted(self.tried, key=lambda t: (t.size, self.bic(t)))]

    def _row(self, t: Tried) -> dict:
        best = self.chosen
        whole, mine = float(best.held.sum()), float(t.held.sum())
        return {
            "model": t.spelled,
            "bic": self.bic(t),
            "bic_above_best": self.bic(t) - self.bic(best),
            "held_out_above_best": float(np.sqrt(mine / whole)) - 1.0 if whole > 0 else 0.0,
            "free": t.size,
            "converged": bool(np.isfinite(t.chi2)),
            "relative_rms": t.relative_rms,
            "seconds": t.seconds,
            "verdict": self._verdict(t),
        }

    def _verdict(self, t: Tried) -> str:
        if t is self.chosen:
            return "chosen"
        if t.size < self.chosen.size:
            return "leaves structure in the residuals"
        gain = self.gain(self.chosen, t)
        said = {"BIC": self.bic(t) < self.bic(self.chosen), "held-out directions": gain.asked}
        asks = [name for name, yes in said.items() if yes]
        return (
            "not asked for" if not asks else f"asked for by {' and '.join(asks)}" + (" alone" if len(asks) == 1 else "")
        )


def bic(t: Tried, unit: float, worth: float, count: int) -> float:
    """χ² of the independent readings, and the price of the free numbers."""
    return t.chi2 / (unit * worth) + t.size * float(np.log(max(count / worth, 2.0)))
