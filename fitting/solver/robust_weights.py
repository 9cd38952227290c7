"""Fits that outliers do not move: readings far off count less, by weights that are found again until nothing moves.

Iteratively reweighted least squares [Holland & Welsch 1977]: each residual r is compared with a scale s, and r² gets
the weight w(r/s). The scale is the median absolute deviation of readings of like brightness, since the noise of a BRDF
grows with it.
"""

import dataclasses
import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.median import sorted_median
from gonio.fitting.problem.problem import FitProblem
from gonio.fitting.solver.levenberg_marquardt import NEAR, Descent, minimise

NORMAL_MAD = 1.482602218505602  # standard deviation of normal noise over its median absolute deviation
TUKEY, HUBER_LIKE, FREEDOM = 4.685, 1.345, 4.0  # 95 % efficient for normal noise; Student's ν [Lange et al. 1989]
CLASS = 60  # readings of one class of brightness, at least
ROUNDS = 60
SCALED = 8  # rounds in which the scale is estimated again
STEADY = 1e-8  # relative change of the numbers from which on the weights have settled
FEW_ROUNDS = 8  # of soft weights on the coarse cells
MOST_ENDS = 4  # descents that go on
DIFFERENT = 0.01  # relative difference of numbers from which on two ends are not the same


class Weights(NamedTuple):
    """Weights w(t) of residuals t in units of their scale, and the slope of w(t)·t."""

    w: np.ndarray
    slope: np.ndarray


def _tukey(t: np.ndarray) -> Weights:
    inside = np.maximum(1.0 - (t / TUKEY) ** 2, 0.0)
    return Weights(inside**2, inside * (1.0 - 5.0 * (t / TUKEY) ** 2))


def _student(t: np.ndarray) -> Weights:
    below = FREEDOM + t * t
    return Weights((FREEDOM + 1.0) / below, (FREEDOM + 1.0) * (FREEDOM - t * t) / below**2)


def _soft_l1(t: np.ndarray) -> Weights:
    s = 1.0 + (t / HUBER_LIKE) ** 2
    return Weights(s**-0.5, s**-1.5)


KINDS: dict[str, Callable[[np.ndarray], Weights]] = {"tukey": _tukey, "student": _student, "soft-l1": _soft_l1}


@dataclasses.dataclass(frozen=True)
class DownweightedReadings:
    """The readings that a robust fit counts less: the share of its weight that each keeps, (n, C).

    `scale`: median of the residuals' scale, in the units of the loss; `widening`: factor of the standard uncertainties,
    for the slope of w(t)·t [Huber 1981, §7.6].
    """

    kind: str
    kept: np.ndarray
    scale: float
    widening: float


@dataclasses.dataclass(frozen=True)
class RobustFit:
    """The end of reweighted descents: the last descent, its problem, what counts less, whether the weights settled."""

    descent: Descent
    problem: FitProblem
    downweighted: DownweightedReadings
    settled: bool


def scales(residual: np.ndarray, model: np.ndarray, valid: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Scale s of each residual, same shape: 1.4826 times the median of |r| among readings of like brightness.

    Classes halve from the darkest half upwards, so that a highlight is not held to the noise of what is dark; none is
    smaller than `CLASS`. `least`: a lower limit; one hundredth of the scale of all is another.
    """
    whole = bool(valid.all())
    size, level = (np.abs(a.ravel() if whole else a[valid]) for a in (residual, model))
    if not size.size:
        return np.ones_like(residual)
    edges = [0]
    while size.size - edges[-1] >= 2 * CLASS:
        edges.append(edges[-1] + (size.size - edges[-1]) // 2)
    ordered = np.sort(level)
    starts = np.searchsorted(ordered, ordered[edges])  # what is equally bright stays together
    starts = starts[1:][np.diff(starts) >= CLASS]
    floor = max(least, 0.01 * NORMAL_MAD * sorted_median(size), np.finfo(float).tiny ** 0.5)
    number = np.zeros(size.size, np.int8)
    for threshold in ordered[starts]:
        number += ~(level < threshold)
    by_class = size[np.argsort(number, kind="stable")]
    spans = itertools.pairwise([0, *starts.tolist(), size.size])
    each = np.array([max(NORMAL_MAD * sorted_median(by_class[a:b]), floor) for a, b in spans])[number]
    if whole:
        return each.reshape(residual.shape)
    scale = np.ones_like(residual)
    scale[valid] = each
    return scale


def robust_fit(problem: FitProblem, kind: str, cells: np.ndarray, ends: list[Descent]) -> RobustFit:
    """Iteratively reweighted least squares, from where descents of ordinary least squares ended.

    Outliers lead least squares astray, so that several of the ends are tried on the cells `cells`, with weights that
    never reach 0; the one that leaves most readings close is gone on with, on all readings.

    Args:
        problem: all readings, with the weights of least squares.
        kind: of `KINDS`.
        cells: indices of some cells.
        ends: descents, the best one first.
    """
    few = problem.subset(cells)
    used = few.weight > 0
    softened = [_reweighted(few, "soft-l1", end.p, FEW_ROUNDS).descent for end in _different(ends)]
    deviations = [_scaled_residuals(few, end.p) for end in softened]
    common = min((s for _, s in deviations), key=lambda s: float(np.median(s[used])))
    best = int(np.argmin([np.sum(np.log1p((r / common)[used] ** 2)) for r, _ in deviations]))
    return _reweighted(problem, kind, softened[best].p, ROUNDS)


def _scaled_residuals(problem: FitProblem, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(weighted residuals at p, scale of each), (n, C) each."""
    f = problem.model_values(p)
    residual = problem.residuals(f)
    return residual, scales(residual, f, problem.weight > 0, 1.0 if problem.loss == "sigma" else 0.0)


def _reweighted(problem: FitProblem, kind: str, p: np.ndarray, rounds: int) -> RobustFit:
    """Descents from p with weights by the residuals of the one before, until the numbers settle."""
    used, scale = problem.weight > 0, np.empty(0)
    for done in range(rounds):
        residual, now = _scaled_residuals(problem, p)
        # Fixed from there on: a scale that follows every step keeps the weights from settling.
        scale = now if done < SCALED else scale
        kept = np.where(used, KINDS[kind](residual / scale).w, 1.0)
        weighted = problem.reweighted(problem.weight * np.sqrt(kept))
        end = minimise(weighted, [p], NEAR)[0]
        moved = np.max(np.abs(end.p - p) / np.maximum(np.abs(end.p), 1e-6), initial=0.0)
        p = end.p
        if moved < STEADY:
            break
    residual, scale = _scaled_residuals(problem, p)
    w, slope = (a[used] for a in KINDS[kind](residual / scale))
    # The matrix is Σ w JJᵀ; that of the estimate is Σ ψ' JJᵀ.
    widening = float(np.mean(w) / max(float(np.mean(slope)), 1e-3))
    downweighted = DownweightedReadings(kind, kept, float(np.median(scale[used])), widening)
    return RobustFit(end, weighted, downweighted, bool(moved < STEADY))


def _different(ends: list[Descent]) -> list[Descent]:
    """The first, and the best of the others whose numbers differ from all kept by more than 1 %."""
    kept = [ends[0]]
    for e in sorted((e for e in ends[1:] if np.isfinite(e.cost)), key=lambda e: e.cost):
        apart = (np.max(np.abs(e.p - o.p) / np.maximum(np.abs(o.p), 1e-6), initial=0.0) for o in kept)
        if all(a > DIFFERENT for a in apart):
            kept.append(e)
    return kept[:MOST_ENDS]
