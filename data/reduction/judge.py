"""What a reduced table errs by in a scene: against the whole table, and against the surface."""

import dataclasses
from collections.abc import Callable

import numpy as np

from gonio.data.reduction.table_resolution import Resolution, known_truth, measured_error, resolution
from gonio.data.reduction.thin_grid import SceneValues
from gonio.data.scene import ScenePairs
from gonio.data.table import Table
from gonio.models.errors import one_line


@dataclasses.dataclass(frozen=True)
class Judge:
    """What a reduced table errs by, against the whole one and against the surface."""

    check: SceneValues
    tolerance: float
    truth: np.ndarray | None
    """f of the material that the provenance names."""
    whole: Resolution
    parts: int = 1
    """Groups of channels, of which the one that errs most counts."""

    @classmethod
    def of(cls, whole: Table, check: SceneValues, tolerance: float, parts: int = 1) -> "Judge":
        """That of a whole table, whose own error is measured against the material of its provenance, or estimated."""
        truth = known_truth(whole, check.pairs)
        if truth is None:
            names = np.array_split(np.array(whole.channels.names), parts)
            values = np.array_split(check.f, parts, axis=1)
            each = [
                resolution(whole.only(some.tolist()) if parts > 1 else whole, check._replace(f=f))
                for some, f in zip(names, values, strict=True)
                if parts == 1 or f.any()
            ]
            return cls(check, tolerance, None, max(each, key=lambda r: r.error), parts)
        name = one_line(str(whole.provenance["material"].get("name") or "the material"), 80)
        reason = f"measured against {name}, which the provenance names"
        error = _largest(measured_error, check.pairs, check.f, truth, parts)
        return cls(check, tolerance, truth, Resolution(error, reason), parts)

    @property
    def keeps(self) -> bool:
        """Whether the whole table is within the tolerance."""
        return self.whole.error <= self.tolerance

    @property
    def allowed(self) -> float:
        """The error against the whole table at which the search begins."""
        if self.truth is not None or not self.keeps:
            return self.tolerance
        return (self.tolerance - self.whole.error) / (1 + self.whole.error)

    def errors(self, f: np.ndarray) -> tuple[float, float]:
        """(error against the whole table, bound on that against the surface) of values f (N, C)."""
        error = _largest(ScenePairs.error, self.check.pairs, f, self.check.f, self.parts)
        if self.truth is not None:
            return error, _largest(measured_error, self.check.pairs, f, self.truth, self.parts)
        return error, self.whole.error + error * (1 + self.whole.error)


def _largest(
    error_of: Callable[[ScenePairs, np.ndarray, np.ndarray], float],
    pairs: ScenePairs,
    f: np.ndarray,
    truth: np.ndarray,
    parts: int,
) -> float:
    """The largest error of groups of channels, each relative to its own radiance; a dark one has none."""
    both = zip(*(np.array_split(a, parts, axis=1) for a in (f, truth)), strict=True)
    return max((error_of(pairs, a, b) for a, b in both if parts == 1 or b.any()), default=0.0)
