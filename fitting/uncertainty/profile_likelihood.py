"""Intervals of numbers known so vaguely that their cost is no parabola: profile likelihood [James & Roos 1975].

A number is fixed at a value and all others are fitted again; its interval ends where the cost has risen by what 95 %
confidence allows. In a valley that bends, the covariance at its bottom says little about its ends. The ends of all
numbers are searched side by side, each fit from the last one, no better than the ends need, and with a budget: where
that is spent, intervals are those of the covariance, and the result says so.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.fitting.problem.parameterisation import LINEAR, LOG, Domains
from gonio.fitting.problem.readings import LANES
from gonio.fitting.solver.levenberg_marquardt import Stopping, minimise
from gonio.fitting.uncertainty.covariance import FACTOR_OPEN, NORMAL_95, WIDE_OPEN, Covariance, open_from
from gonio.fitting.uncertainty.joint_covariance import parallel
from gonio.fitting.uncertainty.optimum import ALONG, FOLLOWED, Optimum

CLOSE = 0.03  # relative error of an interval's end
TRIALS = 14
ENOUGH = 2e-3  # of the allowed rise: what a fit with a number fixed may leave
STEPS = 40  # of such a fit
LITTLE, MUCH = 1 / 3, 3.0  # rises, as shares of what is allowed, beyond which a trial need not know its own
HIGHEST = 10.0  # rise that a secant is taken from: no trial comes nearer than a tenth of the way
BUDGET = 3e7  # evaluations of the model at a sample: about three seconds on one thread
FEW = 4  # channels that cost no more than one
FAR = 3.0  # standard deviations, and the factor of e to this power that is open there: for a parabola, the same thing
FAR_OPEN = FACTOR_OPEN * FAR / NORMAL_95
MOST = 6  # numbers that are followed


def with_profiles(e: Optimum, vague: list[int]) -> Optimum:
    """The optimum with profile intervals of its vague numbers, those that are open after all called undetermined."""
    reach = open_from(e.domains, e.p)
    followed = {k: _searches(e, k) for k in vague[:MOST]}
    budget = _follow(e, [s for pair in followed.values() for s in pair], BUDGET)
    profile = {
        k: (float(low.end), float(high.end))
        for k, (low, high) in followed.items()
        if np.isfinite([low.end, high.end]).all()
    }
    # Noise may seem to decide where a bent valley hardly does: three standard deviations see its far side.
    far = {
        k: [s.farther(FAR) for s in followed[k]]
        for k, ends in profile.items()
        if not is_open(e.domains, k, ends, float(e.p[k]))
    }
    _follow(e, [s for pair in far.values() for s in pair], budget)
    covariance = e.covariance
    for k, ends in profile.items():
        opened = k not in far
        if not opened:
            ends = (far[k][0].end, far[k][1].end)
            opened = bool(np.isfinite(ends).all()) and is_open(e.domains, k, ends, float(e.p[k]), FAR_OPEN)
        if opened:

            def opened_in_view(
                c: Covariance, k: int, index: np.ndarray, ends: tuple[float, float] = ends
            ) -> Covariance:
                return _opened(c, k, ends, reach[index], e.p[index])

            covariance = covariance.changed(k, opened_in_view)
    unfollowed = tuple(k for k in vague if k not in profile)
    return dataclasses.replace(e, profile=profile, covariance=covariance, unfollowed=unfollowed)


def is_open(d: Domains, k: int, ends: tuple[float, float], value: float, factor: float = FACTOR_OPEN) -> bool:
    """Whether an interval of number k spans its domain, or a factor of e to `factor` (see `open_from`)."""
    low, high = float(d.low[k]), float(d.high[k])
    if d.kind[k] == LINEAR:
        apart = ends[1] - ends[0]
        if apart >= 0.999 * (high - low):
            return True
        if factor == FACTOR_OPEN:
            return apart >= 0.999 * max(WIDE_OPEN * abs(value), 1.0)
        return apart >= 1.0 and ends[0] * np.exp(factor) <= ends[1]
    shift = 0.0 if d.kind[k] == LOG else 1.0
    width = np.log((high + shift) / (low + shift))
    return np.log((ends[1] + shift) / (ends[0] + shift)) >= 0.999 * min(width, factor)


def _opened(c: Covariance, k: int, ends: tuple[float, float], reach: np.ndarray, p: np.ndarray) -> Covariance:
    undetermined = c.undetermined.copy()
    undetermined[k] = True
    column = np.nan_to_num(c.matrix[:, k])
    change = column / np.max(np.abs(column) / reach)
    variance = max(1.0, ((ends[1] - ends[0]) / (2 * NORMAL_95 * reach[k])) ** 2)
    # Others that go with it are as open as it is.
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.abs(c.correlation[:, k]) > ALONG
    vague = np.sqrt(np.nan_to_num(np.diagonal(c.matrix))) > FOLLOWED * np.minimum(reach, np.abs(p))
    undetermined |= alike & vague
    same = [v for v, other in c.combinations if parallel(change / reach, other / reach)]
    return Covariance(c.matrix, undetermined, c.combinations if same else [*c.combinations, (variance, change)])


class _Fit(NamedTuple):
    """A fit with a number fixed: its distance from its value, its rise in standard deviations, all numbers (P,)."""

    distance: float
    rise: float
    p: np.ndarray


@dataclasses.dataclass
class _Search:
    """The search for where the profile of number k, below (−1) or above (1) its value, has risen by what is allowed."""

    k: int
    sign: float
    deviations: float  # standard deviations that are allowed
    allowed: float  # cost of one of them squared
    column: np.ndarray  # change of all numbers a unit of this one, along the valley's bottom
    value: float
    room: float  # to the bound
    distance: float  # of the next trial from the value
    fits: list[_Fit]  # of all trials, the first of them the optimum itself
    within: tuple[float, float] = (0.0, 0.0)  # distance, and rise as a share of what is allowed
    beyond: tuple[float, float] | None = None
    end: float = np.nan
    done: bool = False
    trials: int = 0
    inwards: bool | None = None  # whether the last trial rose more than is allowed

    @property
    def trial(self) -> float:
        """The value that the number is fixed at next."""
        return self.value + self.sign * self.distance

    @property
    def bound(self) -> bool:
        """Whether that is the domain's end."""
        return self.distance >= self.room * (1 - 1e-12)

    @property
    def sufficient(self) -> tuple[float, float]:
        """Rises as shares of what is allowed that say enough: up to the first one, and from the second one on."""
        return (1.0 - CLOSE if self.bound else LITTLE, MUCH)

    def guess(self, d: Domains) -> np.ndarray:
        """Numbers to begin at: straight on from the last ones that rose less."""
        start = max((fit for fit in self.fits if fit.rise < self.deviations), key=lambda fit: fit.distance)
        p = start.p + self.sign * (self.distance - start.distance) * self.column
        p = np.clip(p, d.low, d.high)
        p[self.k] = self.trial
        return p

    def learn(self, p: np.ndarray, above: float) -> None:
        """Take in the fit with the number fixed: its numbers, and its cost above the minimum's."""
        self.trials += 1
        if not np.isfinite(above):
            self.done = True
            return
        self.fits.append(_Fit(self.distance, float(np.sqrt(max(above, 0.0) / self.allowed)), p))
        rise = self.fits[-1].rise / self.deviations
        if abs(rise - 1.0) < CLOSE or (rise < 1.0 and self.bound):
            self.finish(self.distance)
            return
        self._narrow(self.distance, rise)
        if self.trials >= TRIALS:
            self.finish(self.distance if self.beyond is None else self.beyond[0])

    def _narrow(self, distance: float, rise: float) -> None:
        """Where to look next, by the secant; an end that stays twice counts half (the Illinois rule)."""
        (a, rise_a), inwards = self.within, rise >= 1.0
        if inwards:
            self.beyond = (distance, min(rise, HIGHEST))
            if self.inwards and a > 0:
                self.within = (a, 0.5 * (1.0 + rise_a))
        else:
            self.within = (distance, rise)
            if self.inwards is False and self.beyond is not None:
                self.beyond = (self.beyond[0], 0.5 * (1.0 + self.beyond[1]))
        self.inwards = inwards
        if self.beyond is None:
            # A rise that slows down would be chased for ever: at most three times as far at once.
            slope = (rise - rise_a) / (distance - a)
            further = (1.0 - rise) / max(slope, 1e-3 / distance)
            self.distance = min(distance + min(max(further, 0.05 * distance), 2.0 * distance), self.room)
        else:
            self.distance = self._between()

    def _between(self) -> float:
        assert self.beyond is not None
        (a, rise_a), (b, rise_b) = self.within, self.beyond
        return a + float(np.clip((1.0 - rise_a) / (rise_b - rise_a), 0.1, 0.9)) * (b - a)

    def finish(self, distance: float) -> None:
        """End here."""
        self.end, self.done = self.value + self.sign * distance, True

    def farther(self, deviations: float) -> "_Search":
        """The search for more standard deviations, from what this one has fitted."""
        less = [(fit.distance, fit.rise / deviations) for fit in self.fits if fit.rise < deviations]
        within = max(less)
        more = [(fit.distance, fit.rise / deviations) for fit in self.fits if fit.rise >= deviations]
        beyond = min(((d, min(rise, HIGHEST)) for d, rise in more if d > within[0]), default=None)
        further = dataclasses.replace(
            self, deviations=deviations, within=within, beyond=beyond, end=np.nan, done=False, trials=0, inwards=None
        )
        far = min(max(abs(self.end - self.value), within[0]) * deviations / self.deviations, self.room)
        further.distance = further._between() if further.beyond else far
        return further


def _searches(e: Optimum, k: int) -> list[_Search]:
    variance, value = float(e.covariance.variance[k]), float(e.p[k])
    column, unit, searches = e.covariance.column(k) / variance, 0.5 * _unit_variance(e, k), []
    for sign, bound in ((-1.0, e.domains.low[k]), (1.0, e.domains.high[k])):
        room = abs(float(bound) - value)
        distance = min(NORMAL_95 * np.sqrt(variance), room)
        search = _Search(k, sign, NORMAL_95, unit, column, value, room, distance, [_Fit(0.0, 0.0, e.p)])
        if room <= 0:
            search.end, search.done = float(bound), True
        searches.append(search)
    return searches


def _follow(e: Optimum, searches: list[_Search], budget: float) -> float:
    """Bring the searches to their ends, all of them side by side; evaluations of the model that are left."""
    samples = e.problem.size * max(1.0, e.parameters.channels / FEW)
    d = e.domains
    while pending := [s for s in searches if not s.done]:
        for some in (pending[first : first + LANES] for first in range(0, len(pending), LANES)):
            if budget < 0:
                for s in pending:
                    s.done = True
                return budget
            low, high = (np.tile(np.asarray(bound, float), (len(some), 1)) for bound in (d.low, d.high))
            for lane, s in enumerate(some):
                low[lane, s.k] = high[lane, s.k] = s.trial
            problem = dataclasses.replace(e.problem, domains=d._replace(low=low, high=high))
            enough = ENOUGH * min(s.allowed * s.deviations**2 for s in some)
            starts = [s.guess(d) for s in some]
            rises = np.array([s.sufficient for s in some]) ** 2
            limits = e.cost + rises * np.array([[s.allowed * s.deviations**2] for s in some])
            stopping = Stopping(near=True, enough=enough, most=STEPS, below=limits[:, 0], above=limits[:, 1])
            ends = minimise(problem, starts, stopping)
            budget -= sum(end.steps for end in ends) * samples
            for s, end in zip(some, ends, strict=True):
                s.learn(end.p, end.cost - e.cost)
    return budget


def _unit_variance(e: Optimum, k: int) -> float:
    """Variance of number k over that of a unit noise: 1 where the noise is known."""
    view = next(v for v in e.covariance.views if k in v.index)
    index = np.flatnonzero(np.isfinite(np.diagonal(view.covariance.matrix)))
    matrix = view.information[np.ix_(index, index)]
    lengths = np.sqrt(np.diagonal(matrix))
    inverse = np.linalg.pinv(matrix / np.outer(lengths, lengths), rcond=1e-14, hermitian=True)
    place = int(np.flatnonzero(view.index[index] == k)[0])
    return float(e.covariance.variance[k] / (inverse[place, place] / lengths[place] ** 2))
