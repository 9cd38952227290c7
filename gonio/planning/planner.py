"""The planner: from shares of the time to shots, whose travel prices the next choice."""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.instrument.instrument import Instrument
from gonio.instrument.pace import scan_order
from gonio.instrument.scans import in_plane, isotropic, spherical
from gonio.models.errors import GonioError
from gonio.planning.candidates import candidates, readable, space_filling
from gonio.planning.design import (
    Design,
    Problem,
    best_shares,
    covariance,
    criterion,
    gram,
    optimal_design,
    require_determined,
)
from gonio.planning.prior import Prior
from gonio.planning.shots import LEAST_SECONDS, SOLVER_SECONDS, Shots, Sites, ordered

ROUNDS, MOST_ROUNDS = 3, 8
"""Choose, order, and price again by the travel that came out; more rounds where that was too long."""
QUICK_SECONDS = 0.2
"""Of the solver of the path, where the next round makes another."""
TRAVEL = 2.0
"""Seconds between two shots, before any are ordered."""
RELEVANT = 1e-3
"""Share of the time from which on a direction is taken."""
MOST_FILLING = 300
RELINEARISED = 4
MOST_WAY = 0.9
"""Share of the time that may pass moving."""
REGULAR_STEPS = (45.0, 30.0, 15.0, 10.0, 5.0)
PLANE_STEPS = (30.0, 15.0, 10.0, 5.0, 2.0, 1.0)


class Schedule(NamedTuple):
    """Shots in their order, the design that they round, seconds on the way (settling included)."""

    shots: Shots
    design: Design
    way: float


@dataclasses.dataclass
class Planner:
    """Plans of any length for one purpose.

    Attributes:
        prior: the model that is measured.
        instrument: which counts.
        rival: another model, from which the first is to be separated; None: the first model's numbers are wanted.
        wanted: combinations (S, Q, P) of the numbers that are to be known; None: all of them, by log det.
        known: rows (1, n, 1, P + Q) of what was read before, with the same instrument.
        space_filling: share of the time for directions that fill the range evenly.
    """

    prior: Prior
    instrument: Instrument
    rival: Prior | None = None
    wanted: np.ndarray | None = None
    known: np.ndarray | None = None
    space_filling: float = 0.2

    def __post_init__(self) -> None:
        self.isotropic = self.prior.brdf(self.prior.p).isotropic
        angles = candidates(self.instrument, self.isotropic)
        if not angles.size:
            raise GonioError("the instrument reaches no direction; give larger ranges, or a smaller shadow")
        self.candidates = self.sites(angles)
        self.size = self.candidates.slopes.shape[-1]
        rows = self.candidates.rows(np.ones(angles.shape[1]))[:1]
        self.before = np.zeros((1, *[rows.shape[-1]] * 2))
        if self.known is not None:
            self.before = gram(self.known, np.ones(self.known.shape[1]))
        if self.rival is not None:
            self.wanted = np.eye(self.size)[None, -1:]
        every = (gram(rows, np.ones(angles.shape[1])) + self.before)[0, : self.size, : self.size]
        require_determined(every, (self.rival or self.prior).names + ["the difference"] * (self.rival is not None))

    def sites(self, angles: np.ndarray) -> Sites:
        """The model's information at some directions (4, n).

        Against a rival it is that on the rival's numbers and on the amount of the difference, so that the variance of
        this amount is one over the T-criterion [Atkinson & Fedorov 1975], in the rival's linear neighbourhood.
        """
        here = Sites.of(
            self.prior, self.instrument, angles, self.prior.draws if self.rival is None else self.prior.p[None]
        )
        if self.rival is None:
            return here
        f, slopes = self.rival.at_angles(self.rival.p, angles)
        return dataclasses.replace(here, slopes=np.concatenate([slopes, (here.f[0] - f)[..., None]], axis=-1)[None])

    def schedule(self, budget: float) -> Schedule:
        """The best shots for so many seconds."""
        settling, travel = self.instrument.pace.settling, TRAVEL
        overhead, rounds = settling + travel, ROUNDS if self.rival is None else RELINEARISED
        for number in range(MOST_ROUNDS):
            times = self.candidates.best_seconds(overhead, budget)
            filling, spread = self._filling(budget, settling + travel)
            share = self.space_filling if filling.seconds.size else 0.0
            rate = self.candidates.rows(times) * np.sqrt(budget * (1 - share) / (times + overhead))[:, None, None]
            problem = Problem(rate, self.before + spread, self.size, self.wanted)
            design = optimal_design(problem)
            chosen = self._rounded(design.shares, problem, times, ((1 - share) * budget, overhead, travel))
            both = (np.concatenate(a, axis=-1) for a in zip(chosen, filling, strict=True))
            patience = SOLVER_SECONDS if number >= rounds - 1 else QUICK_SECONDS
            shots = ordered(Shots(*both), self.instrument.pace, patience)
            way = self.instrument.pace.path_seconds(shots.angles, 0.0)
            overhead = way / shots.seconds.size
            travel = (way - settling * shots.seconds.size) / np.unique(shots.angles, axis=1).shape[1]
            if self.rival is not None:
                self._relinearise(rate, design.shares)
            if number >= rounds - 1 and way <= MOST_WAY * budget:
                break
        if way > MOST_WAY * budget:
            raise GonioError(f"{_too_short(budget)}: the axes alone need {way:.0f} s; give more time")
        seconds = np.round(shots.seconds * (budget - way) / shots.seconds.sum(), 3)
        return Schedule(Shots(shots.angles, np.maximum(seconds, 1e-3)), design, way)

    def covariance(self, shots: Shots) -> np.ndarray:
        """Covariance (P, P) of the numbers after some shots."""
        rows = self.sites(shots.angles).rows(shots.seconds)[:1]
        return covariance(gram(rows, np.ones(shots.seconds.size)) + self.before, self.size)[0][0]

    def loss(self, covariance: np.ndarray) -> float:
        """What a covariance loses by the criterion of the plan, at the likeliest numbers."""
        if self.wanted is None:
            return float(np.linalg.slogdet(covariance)[1])
        return float(np.log(np.einsum("qi,ij,qj->", self.wanted[0], covariance, self.wanted[0])))

    def regular(self, budget: float) -> tuple[str, Shots] | None:
        """The best regular scan of so many seconds, and its name; None where none fits in."""
        schemes = [(f"in the plane by {s:g}°", in_plane, s) for s in PLANE_STEPS if self.isotropic]
        grid, name = (isotropic, "isotropic") if self.isotropic else (spherical, "spherical")
        schemes += [(f"{name} by {s:g}°", grid, s) for s in REGULAR_STEPS if self.isotropic or s > 10]
        best: tuple[float, str, Shots] | None = None
        for title, make, step in schemes:
            layout = make(np.radians(step))
            angles = np.stack([np.asarray(a)[scan_order(layout)] for a in layout.angles()])
            shots = self.evenly(readable(angles, self.instrument), budget)
            if shots is None:
                continue
            try:
                loss = self.loss(self.covariance(shots))
            except np.linalg.LinAlgError:
                continue
            if np.isfinite(loss) and (best is None or loss < best[0]):
                best = loss, title, shots
        return best and best[1:]

    def evenly(self, angles: np.ndarray, budget: float) -> Shots | None:
        """Shots in directions (4, n) as they come, counted equally long; None where the way takes too long."""
        if not angles.size:
            return None
        each = (budget - self.instrument.pace.path_seconds(angles, 0.0)) / angles.shape[1]
        return Shots(angles, np.full(angles.shape[1], each)) if each > 1e-3 else None

    def _filling(self, budget: float, overhead: float) -> tuple[Shots, np.ndarray]:
        """Shots that fill the range, and the Gram matrix of their rows."""
        time = self.space_filling * budget
        count = min(int(time / (2 * overhead)), MOST_FILLING)
        angles = space_filling(self.instrument, self.isotropic, count) if count else np.zeros((4, 0))
        if not angles.size:
            return Shots(np.zeros((4, 0)), np.zeros(0)), np.zeros_like(self.before)
        seconds = np.full(angles.shape[1], max(time / angles.shape[1] - overhead, LEAST_SECONDS))
        rows = self.sites(angles).rows(seconds)
        return Shots(angles, seconds), gram(rows, np.ones(angles.shape[1]))

    def _rounded(
        self, shares: np.ndarray, problem: Problem, times: np.ndarray, terms: tuple[float, float, float]
    ) -> Shots:
        """Whole shots for the shares; a direction is left out where the others use its time better.

        `terms`: seconds of them all, on the way to a shot in the mean, and of travel to a new direction.
        """
        budget, overhead, travel = terms
        support = np.flatnonzero(shares > RELEVANT)
        weights = shares[support] / shares[support].sum()
        best: tuple[float, Shots] | None = None
        while support.size:
            count = np.maximum(1, np.rint(budget * weights / (times[support] + overhead))).astype(int)
            left_over = budget - travel * support.size - self.instrument.pace.settling * count.sum()
            seconds = np.maximum(weights / count, 1e-9)
            seconds *= left_over / (seconds @ count)
            value = -np.inf
            if seconds.min() > 0:
                rows = self.candidates.part(support).rows(seconds)
                value = criterion(problem._replace(rows=rows), count.astype(float)).value
            if value > (-np.inf if best is None else best[0]):
                best = value, Shots(np.repeat(self.candidates.angles[:, support], count, axis=1), seconds.repeat(count))
            elif best is not None and value < best[0] - 1.0:
                break
            keep = np.arange(support.size) != np.argmin(weights)
            support, weights = support[keep], weights[keep]
            if support.size:
                weights = best_shares(problem.part(support), weights / weights.sum())
        if best is None:
            raise GonioError(f"{_too_short(budget)} to determine all free numbers; give more time, or fewer of them")
        return best[1]

    def _relinearise(self, rate: np.ndarray, shares: np.ndarray) -> None:
        """Moves the rival's numbers to where it comes nearest to the model in the directions of a design."""
        assert self.rival is not None
        flat = (rate[0] * np.sqrt(shares)[:, None, None]).reshape(-1, rate.shape[-1])[:, : self.size]
        step = np.linalg.lstsq(flat[:, :-1], flat[:, -1], rcond=1e-10)[0]
        d, p = self.rival.parameterisation.domains, self.rival.p
        # Half a step for as long as it is large beside the number: the models are not linear.
        limit = 0.5 * np.maximum(np.abs(p), 0.05)
        p = np.clip(p + np.clip(step, -limit, limit), d.low, d.high)
        self.rival = dataclasses.replace(self.rival, p=p, draws=p[None])
        self.candidates = self.sites(self.candidates.angles)


def _too_short(budget: float) -> str:
    return f"a budget of {budget:.3g} s is too short"
