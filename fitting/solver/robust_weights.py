"""Fits that outliers do not move: readings far off count less, by weights that are found again until nothing moves.

Iteratively reweighted least squares [Holland & Welsch 1977]: each residual r is compared with a scale s, and r² gets
the weight w(r/s). The scale is the median absolute deviation of readings of like brightness, since the noise of a BRDF
grows with it.
"""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from gonio.fitting.problem.domains import Domains
from gonio.fitting.problem.normal_equations import values
from gonio.fitting.problem.readings import Readings
from gonio.fitting.problem.residuals import reweighed, weighted_residuals
from gonio.fitting.solver.levenberg_marquardt import Problem
from gonio.fitting.solver.multistart import Descent, descend
from gonio.models.errors import GonioError, nearest

NORMAL_MAD = 1.482602218505602  # standard deviation of normal noise over its median absolute deviation
TUKEY, HUBER_LIKE, FREEDOM = 4.685, 1.345, 4.0  # 95 % efficient for normal noise; Student's ν [Lange et al. 1989]
CLASS = 60  # readings of one class of brightness, at least
ROUNDS = 60
SCALED = 8  # rounds in which the scale is found
STEADY = 1e-8  # relative change of the weights' numbers from which on they have settled


def _tukey(t):
    inside = np.maximum(1.0 - (t / TUKEY) ** 2, 0.0)
    return inside**2, inside * (1.0 - 5.0 * (t / TUKEY) ** 2)


def _student(t):
    below = FREEDOM + t * t
    return (FREEDOM + 1.0) / below, (FREEDOM + 1.0) * (FREEDOM - t * t) / below**2


def _soft_l1(t):
    s = 1.0 + (t / HUBER_LIKE) ** 2
    return s**-0.5, s**-1.5


KINDS: dict[str, Callable] = {"tukey": _tukey, "student": _student, "soft-l1": _soft_l1}


@dataclasses.dataclass(frozen=True)
class SetAside:
    """What a robust fit counts less: the share of its least-squares weight that each reading keeps, (n, C)."""

    kind: str
    kept: np.ndarray
    scale: float  # median of the residuals' scale, in the units of the loss
    widening: float  # of the standard uncertainties, for the slope of w(t)·t [Huber 1981, §7.6]


def require_kind(kind: str) -> str:
    """The kind itself; GonioError for one that is not known."""
    if kind not in KINDS:
        raise GonioError(f"Unknown robust weights '{kind}'; {nearest(kind, tuple(KINDS))}")
    return kind


def scales(residual: np.ndarray, model: np.ndarray, valid: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Scale s of each residual, same shape: 1.4826 times the median of |r| among readings of like brightness.

    Classes halve from the darkest half upwards, so that a highlight is not held to the noise of what is dark; none is
    smaller than `CLASS`. `least`: a lower limit; one hundredth of the scale of all is another.
    """
    found = np.ones_like(residual)
    size, level = np.abs(residual[valid]), np.abs(model[valid])
    if not size.size:
        return found
    order = np.argsort(level, kind="stable")
    ends, left = [0], size.size
    while left >= 2 * CLASS:
        ends.append(ends[-1] + left // 2)
        left = size.size - ends[-1]
    ends.append(size.size)
    overall = NORMAL_MAD * float(np.median(size))
    floor = max(least, 0.01 * overall, np.finfo(float).tiny ** 0.5)
    within = np.empty(size.size)
    for a, b in itertools.pairwise(ends):
        within[order[a:b]] = max(NORMAL_MAD * float(np.median(size[order[a:b]])), floor)
    found[valid] = within
    return found


def robustly(
    problem: Callable[..., Problem],
    d: Domains,
    readings: Readings,
    weight: np.ndarray,
    coarse: np.ndarray,
    ends: list[Descent],
    last: Descent,
    options,
    notes: list[str],
) -> tuple[Descent, Problem, np.ndarray, SetAside]:
    """(descent, problem, weights (n, C), what was set aside) of a robust fit, from where least squares ended.

    Outliers lead least squares astray, so that several of its ends are tried on the cells `coarse`, with weights that
    never reach 0; the one that leaves most readings close is gone on with, on all readings.
    """
    least = 1.0 if options.loss == "sigma" else 0.0
    kind = require_kind(options.robust)
    n = readings.f.shape[0]
    whole = _Rounds(problem(readings, weight), d, readings, weight, least)
    few = whole
    if coarse.size < n:
        part = readings.part(coarse)
        few = _Rounds(problem(part, weight[coarse]), d, part, weight[coarse], least)
    softened = [few.run("soft-l1", c.p, 8)[0] for c in _apart([last, *ends])]
    left = [few.residuals(end.p) for end in softened]
    common = min((few.scales(*pair) for pair in left), key=lambda s: float(np.median(s[few.used])))
    best = int(np.argmin([np.sum(np.log1p((r / common)[few.used] ** 2)) for r, _ in left]))
    end, now, kept, settled = whole.run(kind, softened[best].p, ROUNDS)
    if not settled:
        notes.append(f"the robust weights had not settled after {ROUNDS} rounds")
    residual, f = whole.residuals(end.p)
    s = whole.scales(residual, f)
    w, slope = (a[whole.used] for a in KINDS[kind](residual / s))
    # The matrix is Σ w JJᵀ; that of the estimate is Σ ψ' JJᵀ.
    widening = float(np.mean(w) / max(float(np.mean(slope)), 1e-3))
    aside = SetAside(kind, kept, float(np.median(s[whole.used])), widening)
    return end, now, weight * np.sqrt(kept), aside


class _Rounds:
    """Reweighted descents on some readings: the blocks are laid out once, and only their weights change."""

    def __init__(self, base: Problem, d: Domains, readings: Readings, weight: np.ndarray, least: float):
        self.base, self.domains, self.readings, self.weight, self.least = base, d, readings, weight, least
        self.used = weight > 0

    def residuals(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(weighted residuals, model) at p, (n, C) each, with the weights of least squares."""
        q = self.base
        f = values(q.structure, q.loss, p, q.fixed, q.data)[: self.used.shape[0]]
        return weighted_residuals(self.readings, q.loss, float(q.data.floor), self.weight, f), f

    def scales(self, residual: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Scale of each residual, (n, C)."""
        return scales(residual, f, self.used, self.least)

    def run(self, kind: str, p: np.ndarray, rounds: int) -> tuple[Descent, Problem, np.ndarray, bool]:
        """(descent, its problem, share of weight that each reading keeps, whether that settled)."""
        for done in range(rounds):
            residual, f = self.residuals(p)
            if done < SCALED:
                # Held from there on: a scale that follows every step keeps the weights from settling.
                s = self.scales(residual, f)
            kept = np.where(self.used, KINDS[kind](residual / s)[0], 1.0)
            now = reweighed(self.base, self.weight * np.sqrt(kept))
            end = descend(now, self.domains, p)
            moved = np.max(np.abs(end.p - p) / np.maximum(np.abs(end.p), 1e-6), initial=0.0)
            p = end.p
            if moved < STEADY:
                return end, now, kept, True
        return end, now, kept, False


def _apart(ends: list[Descent], most: int = 4) -> list[Descent]:
    # The first, and the best of the others whose numbers differ from all kept by more than 1 %.
    found = [ends[0]]
    for e in sorted((e for e in ends[1:] if np.isfinite(e.cost)), key=lambda e: e.cost):
        if all(np.max(np.abs(e.p - o.p) / np.maximum(np.abs(o.p), 1e-6), initial=0.0) > 0.01 for o in found):
            found.append(e)
    return found[:most]
