"""Many starts on few samples, then the best on all: who agrees with whom."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from gonio.fitting.problem.blocks import LANES
from gonio.fitting.problem.domains import Domains, to_unconstrained
from gonio.fitting.problem.normal_equations import Sums
from gonio.fitting.problem.parameterisation import Structure, count
from gonio.fitting.solver.convergence import eps
from gonio.fitting.solver.levenberg_marquardt import Problem, minimise

ROUNDINGS = 16.0  # of what is compared, by which two costs of one minimum may differ
SAME_COST = 1e-6  # relative difference of two costs that are one minimum


@dataclasses.dataclass(frozen=True)
class Descent:
    """One descent's end: parameters, cost, and how stationary it is."""

    p: np.ndarray
    cost: float
    stationarity: float
    exact: bool
    steps: int
    said_successful: bool
    total: Sums

    @property
    def stationary(self) -> bool:
        """Stationary by the projected gradient, or exact; what the solver said of itself does not count."""
        return self.exact or self.stationarity <= 1e-6


def descend_all(
    problem: Problem,
    domains: Domains,
    starts: Sequence[np.ndarray],
    near: bool = False,
    rough: float = 1.0,
    rivals: bool = False,
) -> list[Descent]:
    """One descent from the parameters (P,) of each start, side by side; what else as `minimise` takes it."""
    found = []
    for first in range(0, len(starts), LANES):
        x = np.stack([to_unconstrained(domains, p) for p in starts[first : first + LANES]])
        ends = minimise(problem, x, near, rough, rivals)
        for k in range(len(x)):
            total = Sums(*(a[k] for a in ends.total))
            found.append(
                Descent(
                    ends.p[k], float(total.cost), float(ends.stationarity[k]), bool(ends.exact[k]), int(ends.steps[k]),
                    bool(ends.successful[k]), total,
                )
            )  # fmt: skip
    return found


def descend(problem: Problem, domains: Domains, start: np.ndarray, near: bool = True) -> Descent:
    """One descent from the parameters `start`, shape (P,), by default near a minimum."""
    return descend_all(problem, domains, [start], near)[0]


def agreeing(ends: list[Descent], best: Descent, target_norm_squared: float) -> int:
    """How many descents ended at the best cost (to 1e-6 of it, or to rounding)."""
    return sum(end.cost <= best.cost + _margin(best.cost, target_norm_squared) for end in ends)


def _margin(cost: float, target_norm_squared: float) -> float:
    return (
        SAME_COST * cost
        + 1e-20 * target_norm_squared
        + ROUNDINGS * eps() * float(np.sqrt(max(cost, 0.0) * target_norm_squared))
    )


def distinct(ends: list[Descent], target_norm_squared: float, most: int = 3) -> list[Descent]:
    """The best descents of different cost, at most `most`, none more than half above the best."""
    found: list[Descent] = []
    for end in sorted((e for e in ends if np.isfinite(e.cost)), key=lambda e: e.cost):
        if found and end.cost > 1.5 * found[0].cost + 1e-20 * target_norm_squared:
            break
        if all(end.cost > f.cost + _margin(f.cost, target_norm_squared) for f in found):
            found.append(end)
    return found[:most]


def ordered_lobes(s: Structure, fixed: tuple[dict, ...], p: np.ndarray) -> np.ndarray:
    """The same model with lobes of one kind in the order of their widths, narrow first: two fits then compare."""

    def kind(t: int) -> tuple:
        held = tuple((n, tuple(np.ravel(v))) for n, v in fixed[t].items())
        return s.frames[t], held, tuple((g.name, g.per_channel) for g in s.groups if g.term == t)

    def width(t: int) -> float:
        return next((float(p[g.first]) for g in s.groups if g.term == t and g.name.startswith("alpha")), 0.0)

    p = p.copy()
    before = p.copy()
    for same in {
        kind(t): [u for u in range(len(s.frames)) if kind(u) == kind(t)] for t in range(len(s.frames))
    }.values():
        for place, taken in zip(same, sorted(same, key=width), strict=True):
            ours, theirs = ([g for g in s.groups if g.term == t] for t in (place, taken))
            for g, h in zip(ours, theirs, strict=True):
                p[g.first : g.first + count(s, g)] = before[h.first : h.first + count(s, h)]
    return p
