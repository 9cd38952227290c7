"""Covariance of all free numbers of a fit, in views: of each channel's own numbers with the shared ones.

A view is exact: the other channels' own numbers are eliminated from it, not left out, so that the cost grows with the
number of channels. Where numbers are few, one view holds them all.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.arrow import WHOLE, Arrow
from gonio.fitting.problem.normal_equations import NormalEquations
from gonio.fitting.problem.parameterisation import Domains
from gonio.fitting.uncertainty.covariance import (
    Covariance,
    CovarianceEstimate,
    at_bounds_covariance,
    lost_below,
    open_from,
)

PARALLEL = 0.9  # cosine of two changes that are one combination


class View(NamedTuple):
    """Covariance (K, K) of some numbers with indices (K,), and their JᵀJ with all others eliminated.

    `channel`: whose own numbers these are, None for those of all channels.
    """

    channel: int | None
    index: np.ndarray
    information: np.ndarray
    covariance: Covariance


class Combination(NamedTuple):
    """An open combination of numbers as in `Covariance.combinations`, its change (P,), and the view that shows it."""

    variance: float
    change: np.ndarray
    view: View


@dataclasses.dataclass(frozen=True)
class JointCovariance:
    """Covariance of P free numbers.

    `slopes` (C, q, s): change of each channel's own numbers with the shared ones, where the cost stays least; None
    where one view holds all numbers.
    """

    size: int
    views: tuple[View, ...]
    slopes: np.ndarray | None

    @property
    def variance(self) -> np.ndarray:
        """Variances (P,): NaN where a bound holds a number, or without visible effect."""
        variance = np.full(self.size, np.nan)
        for v in reversed(self.views):
            variance[v.index] = np.diagonal(v.covariance.matrix)
        return variance

    @property
    def standard(self) -> np.ndarray:
        """Standard uncertainties (P,)."""
        return np.sqrt(self.variance)

    @property
    def undetermined(self) -> np.ndarray:
        """Which numbers (P,) the data leave open."""
        undetermined = np.zeros(self.size, bool)
        for v in self.views:
            undetermined[v.index] |= v.covariance.undetermined
        return undetermined

    def changed(self, k: int, change: Callable[[Covariance, int, np.ndarray], Covariance]) -> "JointCovariance":
        """The same with the view of number k changed: a function of its covariance, its place of k and its indices."""
        number, place = next((n, int(i)) for n, v in enumerate(self.views) for i in np.flatnonzero(v.index == k))
        views, view = list(self.views), self.views[number]
        views[number] = view._replace(covariance=change(view.covariance, place, view.index))
        return dataclasses.replace(self, views=tuple(views))

    def column(self, k: int) -> np.ndarray:
        """Covariance (P,) of number k with all that a view holds together with it, 0 elsewhere and where unknown."""
        column = np.zeros(self.size)
        for v in self.views:
            for place in np.flatnonzero(v.index == k):
                column[v.index] = np.nan_to_num(v.covariance.matrix[:, place])
        return column

    def along(self, chosen: np.ndarray, correlation: float) -> np.ndarray:
        """Which numbers (P,) are correlated with one of the chosen ones (P,) by more than so much."""
        along = np.zeros(self.size, bool)
        for v in self.views:
            along[v.index] |= (np.abs(v.covariance.correlation) > correlation)[:, chosen[v.index]].any(axis=1)
        return along

    def matrix(self) -> np.ndarray:
        """The covariance in full (P, P), between numbers of different channels too."""
        full = np.full((self.size, self.size), np.nan)
        if self.slopes is not None:
            s = self.slopes.shape[2]
            each = np.concatenate([v.index[s:] for v in self.views])
            to_shared = np.concatenate([v.covariance.matrix[s:, :s] for v in self.views])
            slopes = self.slopes.reshape(-1, s)
            # Own numbers of two channels meet through the shared ones alone.
            among = self.views[0].covariance.matrix[:s, :s]
            known = np.isfinite(np.diagonal(among))
            slopes, to_shared, among = slopes[:, known], to_shared[:, known], among[np.ix_(known, known)]
            half = to_shared @ slopes.T
            full[np.ix_(each, each)] = half + half.T - slopes @ among @ slopes.T
            lost = np.isnan(np.concatenate([np.diagonal(v.covariance.matrix)[s:] for v in self.views]))
            full[each[lost], :] = full[:, each[lost]] = np.nan
        for v in self.views:
            full[np.ix_(v.index, v.index)] = v.covariance.matrix
        return full

    def scaled(self, variance: float, d: Domains, p: np.ndarray) -> "JointCovariance":
        """The same with all variances multiplied, and open numbers decided again."""
        views = (
            v._replace(covariance=v.covariance.scaled(variance, Domains(*(a[v.index] for a in d)), p[v.index]))
            for v in self.views
        )
        return dataclasses.replace(self, views=tuple(views))

    def stretched(self, factor: np.ndarray, d: Domains, p: np.ndarray) -> "JointCovariance":
        """The same with the standard uncertainties times factors (P,), and open numbers decided again."""
        views = (
            v._replace(
                covariance=v.covariance.scaled(
                    np.outer(factor[v.index], factor[v.index]), Domains(*(a[v.index] for a in d)), p[v.index]
                )
            )
            for v in self.views
        )
        return dataclasses.replace(self, views=tuple(views))

    def combinations(self, d: Domains, p: np.ndarray) -> list[Combination]:
        """The open combinations, each once: one of shared numbers is seen by every channel."""
        kept: list[Combination] = []
        each = None if self.slopes is None else np.stack([v.index[self.slopes.shape[2] :] for v in self.views])
        reach = open_from(d, p)
        for v in self.views:
            for variance, change in v.covariance.combinations:
                whole = np.zeros(self.size)
                whole[v.index] = change
                if self.slopes is not None:
                    s = self.slopes.shape[2]
                    others = self.slopes @ change[:s]  # the each numbers of the other channels follow
                    others[v.channel] = change[s:]
                    whole[each] = others
                combination = Combination(variance, whole, v)
                if not any(parallel(whole / reach, c.change / reach) for c in kept if c.view is not v):
                    kept.append(combination)
        return kept


def parallel(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two changes of numbers, in units of what counts as open, are one combination."""
    return abs(float(a @ b)) > PARALLEL * float(np.linalg.norm(a) * np.linalg.norm(b))


@dataclasses.dataclass(frozen=True)
class JointEstimate:
    """What the covariance of all numbers is made of: as `CovarianceEstimate`, with matrices as arrows.

    `order`: index, among the numbers, of each number of the arrows (P,).
    """

    equations: NormalEquations
    scores: Arrow | None
    residuals: int
    domains: Domains
    p: np.ndarray
    order: np.ndarray

    def covariance(self, free: np.ndarray) -> JointCovariance:
        """Covariance of the numbers that are `free` (P,): not held by a bound, and with an effect on the residuals."""
        reduced = self._reduced(free)
        estimates = self._estimates(reduced, free)
        return self._joint(reduced, [e.covariance(free[i]) for i, e in zip(reduced.index, estimates, strict=True)])

    def with_bounds(self, active: np.ndarray, silent: np.ndarray) -> tuple[JointCovariance, np.ndarray, np.ndarray]:
        """(covariance, which numbers (P,) a bound holds, how far inside they may lie), see `BoundedCovariance`."""
        free = ~active & ~silent
        reduced, bounded = self._reduced(free), []
        for e, gradient, index in zip(self._estimates(reduced, free), reduced.gradient, reduced.index, strict=True):
            bounded.append(at_bounds_covariance(e, gradient, active[index], silent[index]))
        still, reach = np.ones_like(active), np.full(active.size, np.nan)
        for index, b in zip(reduced.index, bounded, strict=True):
            still[index] &= b.active_bound
            reach[index] = b.reach
        if len(bounded) > 1 and (still != active).any():  # a number let free is free in all views
            return self.covariance(~still & ~silent), still, np.where(still, reach, np.nan)
        return self._joint(reduced, [b.covariance for b in bounded]), still, reach

    def _joint(self, reduced: "_Reduced", covariances: list[Covariance]) -> JointCovariance:
        names = [None] if reduced.slopes is None else range(len(covariances))
        views = tuple(map(View, names, reduced.index, reduced.matrix, covariances))
        return JointCovariance(self.p.size, views, reduced.slopes)

    def _estimates(self, reduced: "_Reduced", free: np.ndarray) -> list[CovarianceEstimate]:
        estimates = []
        for k, index in enumerate(reduced.index):
            scores, domains = (
                None if reduced.scores is None else reduced.scores[k],
                Domains(*(a[index] for a in self.domains)),
            )
            others = int(free.sum() - free[index].sum())
            estimates.append(
                CovarianceEstimate(reduced.matrix[k], scores, self.residuals, domains, self.p[index], others)
            )
        return estimates

    def _reduced(self, free: np.ndarray) -> "_Reduced":
        matrix, order = self.equations.matrix, self.order
        if matrix.sizes.total > WHOLE and matrix.sizes.per_channel:
            return _eliminated(self.equations, self.scores, order, free)
        back = np.argsort(order)

        def plain(a: Arrow) -> np.ndarray:
            return a.whole()[np.ix_(back, back)][None]

        scores = None if self.scores is None else plain(self.scores)
        return _Reduced(np.arange(order.size)[None], plain(matrix), scores, self.equations.gradient[back][None], None)


class _Reduced(NamedTuple):
    """V views of K numbers: their indices (V, K), JᵀJ and scores (V, K, K), gradient (V, K), slopes (C, q, s)."""

    index: np.ndarray
    matrix: np.ndarray
    scores: np.ndarray | None
    gradient: np.ndarray
    slopes: np.ndarray | None


def _eliminated(equations: NormalEquations, scores: Arrow | None, order: np.ndarray, free: np.ndarray) -> _Reduced:
    """The view of each channel: its own numbers with the shared ones, those of the other channels eliminated."""
    s, channels, q = equations.matrix.sizes
    lengths = np.sqrt(equations.matrix.diagonal())
    lengths = np.where(lengths > 0, lengths, 1.0)
    unit = equations.matrix.scaled(1.0 / lengths)
    # Numbers that do not move are not eliminated; combinations that nothing depends on have no inverse.
    moving = unit.restricted(np.where(np.arange(order.size) < s, True, free[order]))
    values, vectors = np.linalg.eigh(moving.blocks)
    inverse = np.where(values > lost_below(s + q), 1.0 / np.maximum(values, 1e-300), 0.0)
    border = (vectors * inverse[:, None, :]) @ (vectors.swapaxes(1, 2) @ moving.border.swapaxes(1, 2))
    taken = moving.border @ border
    shared = _without_rounding(np.asarray(unit.corner) - taken.sum(axis=0), border)
    gradient_s, gradient_own = unit.parts(equations.gradient / lengths)
    moved = (gradient_own[:, None, :] @ border)[:, 0]
    gradient = np.concatenate([gradient_s - moved.sum(axis=0) + moved, gradient_own], axis=1)
    lengths_s, lengths_own = unit.parts(lengths)
    every = np.concatenate([np.broadcast_to(lengths_s, (channels, s)), lengths_own], axis=1)
    outer = every[:, :, None] * every[:, None, :]
    spread = None
    if scores is not None:
        scores = scores.scaled(1.0 / lengths)
        crossed = border.swapaxes(1, 2) @ scores.border.swapaxes(1, 2)
        change = border.swapaxes(1, 2) @ scores.blocks @ border - crossed - crossed.swapaxes(1, 2)
        spread = _assembled(scores.corner + change.sum(axis=0) - change, scores) * outer
    index = np.concatenate([np.broadcast_to(order[:s], (channels, s)), order[s:].reshape(channels, q)], axis=1)
    slopes = -border * lengths_s / lengths_own[:, :, None]
    return _Reduced(index, _assembled(shared + taken, unit) * outer, spread, gradient * every, slopes)


def _assembled(shared: np.ndarray, rest: Arrow) -> np.ndarray:
    """Matrices (C, s + q, s + q) of each channel, from its corner (C, s, s) and an arrow's border and block."""
    above = np.concatenate([shared, rest.border], axis=2)
    return np.concatenate([above, np.concatenate([rest.border.swapaxes(1, 2), rest.blocks], axis=2)], axis=1)


def _without_rounding(corner: np.ndarray, border: np.ndarray) -> np.ndarray:
    """The Schur complement (s, s) without rounding, where own numbers (C, q, s) undo all that shared ones do."""
    values, vectors = np.linalg.eigh((corner + corner.T) / 2)
    length2 = 1.0 + np.sum((border @ vectors) ** 2, axis=(0, 1))
    kept = values > length2 * lost_below(vectors.shape[0] + border.shape[1])
    return (vectors * np.where(kept, values, 0.0)) @ vectors.T
