"""Covariance of a few free numbers, and what it leaves open: single numbers, combinations, numbers held by bounds."""

import dataclasses
import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.parameterisation import LINEAR, LOG, Domains
from gonio.fitting.solver.lm_step import eps

NORMAL_95 = 1.959963984540054
LOST = 1e-13  # eigenvalue of the scaled normal matrix below which double precision sees a combination as free
LOST_ROUNDINGS = 100.0  # the same in other precisions
FACTOR_OPEN = 2.0  # a number is open where its 95 % interval spans its domain, or a factor of e to this power
PUSHED = 2.0  # standard uncertainties beyond its bound, from which on a number belongs there
WIDE_OPEN = 2.0 * math.tanh(FACTOR_OPEN / 2)  # length of the interval [p(1 − t), p(1 + t)] over p, with that ratio
FOLLOWS = 0.9  # share of a number's variance that comes from an open combination, from which on it is open with it
CARRIED = 1 / 3  # standard uncertainties by which what is open may carry a number that counts as known
VAGUE = 0.15  # where it also has at least this relative uncertainty


@dataclasses.dataclass(frozen=True)
class Covariance:
    """Covariance (P, P) of the free numbers: NaN rows where a bound holds a number, or without visible effect.

    `undetermined` (P,): numbers that the data leave open. `combinations` are (variance, change (P,)): a change of the
    numbers that is as large as what counts as open, and its variance in units of that change's square: at least 1, and
    infinite where double precision sees no effect of it at all.
    """

    matrix: np.ndarray
    undetermined: np.ndarray
    combinations: list[tuple[float, np.ndarray]]

    @property
    def standard(self) -> np.ndarray:
        """Standard uncertainties (P,)."""
        return np.sqrt(np.diagonal(self.matrix))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (P, P)."""
        with np.errstate(invalid="ignore"):
            return self.matrix / np.outer(self.standard, self.standard)

    def scaled(self, variance: float | np.ndarray, d: Domains, p: np.ndarray) -> "Covariance":
        """The same times a number or a matrix (P, P) of factors, and open numbers decided again."""
        lost = [(v, change) for v, change in self.combinations if not np.isfinite(v)]
        unseen = self.undetermined & np.isnan(np.diagonal(self.matrix))
        return judged(self.matrix * variance, unseen, lost, d, p)


@dataclasses.dataclass(frozen=True)
class CovarianceEstimate:
    """What a covariance is made of: JᵀJ (P, P), the score covariance or None where the noise is known, domains, p.

    With noise known it is (JᵀJ)⁻¹; else the heteroscedasticity-consistent (JᵀJ)⁻¹ Jᵀdiag(r²)J (JᵀJ)⁻¹ [White 1980] with
    its small-sample factor n/(n − P): the noise of a BRDF is rarely even in a loss. `residuals` is n; of the P
    numbers so many `others` were eliminated before.
    """

    matrix: np.ndarray
    scores: np.ndarray | None
    residuals: int
    domains: Domains
    p: np.ndarray
    others: int = 0

    def covariance(self, free: np.ndarray) -> Covariance:
        """Covariance of the numbers that are `free` (P,): not held by a bound, and with an effect on the residuals."""
        size, matrix = self.p.size, self.matrix
        full = np.full((size, size), np.nan)
        silent = ~np.asarray(free, bool) & (np.diagonal(matrix) <= 0)
        index = np.flatnonzero(free)
        if not index.size:
            return Covariance(full, silent, [])
        lengths = np.sqrt(np.diagonal(matrix)[index])
        scaled = matrix[np.ix_(index, index)] / np.outer(lengths, lengths)
        if not (np.isfinite(scaled).all() and self._scatter_is_finite(index)):  # nothing is known of any
            unseen = silent.copy()
            unseen[index] = True
            return judged(full, unseen, [], self.domains, self.p)
        values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
        lost = values < lost_below(index.size)
        inverse = (vectors[:, ~lost] / values[~lost]) @ vectors[:, ~lost].T
        with np.errstate(all="ignore"):  # a variance too large for a number is not known
            inverse = inverse / lengths / lengths[:, None]
            if self.scores is not None:
                small = self.residuals / max(self.residuals - int(index.size) - self.others, 1)
                # By a root of the scores, so that no variance is negative by rounding.
                sizes, axes = np.linalg.eigh(self.scores[np.ix_(index, index)])
                half = inverse @ (axes * np.sqrt(np.maximum(sizes, 0.0)))
                inverse = half @ half.T * small
        combinations, reach = [], open_from(self.domains, self.p)
        for vector in _sparse(vectors[:, lost]).T:
            change = np.zeros(size)
            change[index] = vector / lengths
            combinations.append((np.inf, change / np.max(np.abs(change) / reach)))
        touched = (np.abs(vectors[:, lost]) > 0.1).any(axis=1) | ~np.isfinite(np.diagonal(inverse))
        for _, change in combinations:
            with np.errstate(invalid="ignore"):
                touched |= np.abs(change[index]) > CARRIED * np.sqrt(np.diagonal(inverse))
        inverse[touched, :] = inverse[:, touched] = np.nan
        full[np.ix_(index, index)] = inverse
        unseen = silent.copy()
        unseen[index[touched]] = True
        return judged(full, unseen, combinations, self.domains, self.p)

    def _scatter_is_finite(self, index: np.ndarray) -> bool:
        """Whether the covariance of scores of these numbers is known, where it is asked for."""
        return self.scores is None or bool(np.isfinite(self.scores[np.ix_(index, index)]).all())


def lost_below(size: int) -> float:
    """Eigenvalue of a normal matrix with unit diagonal below which rounding sees a combination of numbers as free."""
    return max(LOST, LOST_ROUNDINGS * eps()) * size


def judged(
    full: np.ndarray, unseen: np.ndarray, lost: list[tuple[float, np.ndarray]], d: Domains, p: np.ndarray
) -> Covariance:
    """The covariance with what it leaves open: each number by itself, and the combinations that they are open along."""
    undetermined, combinations = unseen.copy(), list(lost)
    index = np.flatnonzero(np.isfinite(np.diagonal(full)))
    reach = open_from(d, p)[index]
    scaled = full[np.ix_(index, index)] / np.outer(reach, reach)
    if index.size and np.isfinite(scaled).all() and (np.diagonal(scaled) > 1).any():
        undetermined[index[np.diagonal(scaled) > 1]] = True
        values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
        for k in np.flatnonzero(values > 1)[::-1]:
            change = np.zeros(p.size)
            change[index] = vectors[:, k] * reach
            combinations.append((float(values[k]), change))
            follows = values[k] * vectors[:, k] ** 2 > FOLLOWS * np.diagonal(scaled)
            vague = np.sqrt(np.diagonal(scaled)) * reach > VAGUE * np.abs(p[index])
            undetermined[index[follows & vague]] = True
    return Covariance(full, undetermined, combinations)


def _sparse(vectors: np.ndarray) -> np.ndarray:
    """Another basis (P, L) of the space that the columns span, in reduced echelon form: few numbers in each."""
    rows = vectors.T.copy()
    for r in range(rows.shape[0]):
        i, j = np.unravel_index(np.argmax(np.abs(rows[r:])), rows[r:].shape)
        rows[[r, r + i]] = rows[[r + i, r]]
        rows[r] /= rows[r, j]
        for other in range(rows.shape[0]):
            if other != r:
                rows[other] -= rows[other, j] * rows[r]
    return np.where(np.abs(rows) < 1e-6, 0.0, rows).T


def open_from(d: Domains, p: np.ndarray) -> np.ndarray:
    """Standard uncertainties (P,) from which on numbers count as open.

    The 95 % interval then spans the domain, or a factor of e² (±76 % of the number); where a fit does not step in its
    logarithm also no less than 1, so that a small albedo is known to be small.
    """
    low, high, kind = (np.asarray(a) for a in (d.low, d.high, d.kind))
    shift = np.where(kind == LOG, 0.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.where(kind == LINEAR, 0.0, np.log((high + shift) / (np.where(kind == LOG, low, 0.0) + shift)))
    curved = np.minimum(width, FACTOR_OPEN) * np.where(kind == LOG, np.maximum(np.abs(p), low), np.abs(p) + shift)
    straight = np.minimum(high - low, np.maximum(WIDE_OPEN * np.abs(p), 1.0))
    return np.where(kind == LINEAR, straight, curved) / (2 * NORMAL_95)


class BoundedCovariance(NamedTuple):
    """Covariance, which numbers (P,) a bound holds, how far inside of it they may lie with 95 % confidence (P,)."""

    covariance: Covariance
    active_bound: np.ndarray
    reach: np.ndarray


def at_bounds_covariance(
    estimate: CovarianceEstimate, gradient: np.ndarray, active_bound: np.ndarray, zero_sensitivity: np.ndarray
) -> BoundedCovariance:
    """The covariance with bounds: a number counts as free where it pushes against its bound no more than noise does.

    That is so where it would be open without the bound: others that go with it would seem to be known.
    """
    active, reach = active_bound.copy(), np.full(active_bound.size, np.nan)
    spread = estimate.covariance(~active & ~zero_sensitivity)
    for k in np.flatnonzero(active & ~zero_sensitivity).tolist():
        free = ~active & ~zero_sensitivity
        others = np.flatnonzero(free)
        free[k] = True
        around = estimate.covariance(free)
        if around.undetermined[k] and np.isnan(around.matrix[k, k]):
            # Rounding sees it as free: alone, or in a combination with others, which are known no better.
            if np.isnan(np.diagonal(around.matrix)[others]).sum() > np.isnan(np.diagonal(spread.matrix)[others]).sum():
                active[k], spread = False, around
            else:
                reach[k] = np.inf
            continue
        beyond, limit = beyond_bound(estimate.matrix, gradient, around.matrix, k, others)
        if around.undetermined[k] and beyond < PUSHED:
            active[k], spread = False, around
        else:
            reach[k] = limit
    return BoundedCovariance(spread, active, reach)


def beyond_bound(
    matrix: np.ndarray, gradient: np.ndarray, spread: np.ndarray, index: int, others: np.ndarray
) -> tuple[float, float]:
    """Of a number on its bound: how far beyond it the cost has its minimum, in standard uncertainties u; and how far
    inside of it the number may lie with 95 % confidence.

    Without the bound the quadratic cost has its minimum a distance m beyond it: the limit is the 95 % point of that
    normal law cut off at the bound. `spread` is the covariance (P, P) with the number `index` let free beside the
    `others` (indices).
    """
    free = np.append(others, index)
    u = float(np.sqrt(spread[index, index]))
    if not (np.isfinite(u) and u > 0):
        return float("nan"), float("nan")
    lengths = np.sqrt(np.maximum(np.diagonal(matrix)[free], 1e-300))
    scaled = matrix[np.ix_(free, free)] / np.outer(lengths, lengths)
    step = -np.linalg.lstsq(scaled, gradient[free] / lengths, rcond=1e-12)[0] / lengths
    beyond = abs(float(step[-1])) / u
    if beyond > 30:
        return beyond, 3.0 * u / beyond  # the normal tail is an exponential there: ln 20 · u²/m
    return beyond, -u * (beyond + NormalDist().inv_cdf(0.025 * math.erfc(beyond / math.sqrt(2.0))))
