"""The planner: from shares of the time to shots, whose travel prices the next choice."""

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from gonio.instrument.instrument import Instrument
from gonio.instrument.pace import scan_order
from gonio.instrument.scans import in_plane, isotropic, spherical
from gonio.models.errors import GonioError
from gonio.planning.balance import balanced
from gonio.planning.candidates import both_turning, candidates, readable
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
from gonio.planning.separation import separating_design
from gonio.planning.shots import LEAST_SECONDS, SOLVER_SECONDS, Shots, Sites, ordered
from gonio.planning.space_filling import space_filling
from gonio.planning.ways import ways_of

ROUNDS, MOST_ROUNDS = 3, 8
"""Choose, order, and price again by the travel that came out; more rounds where that was too long."""
QUICK_SECONDS = 0.2
"""Of the solver of the path, where the next round makes another."""
TRAVEL = 2.0
"""Seconds between two shots, before any are ordered."""
RELEVANT = 1e-3
"""Share of the time from which on a direction is taken."""
FILLING = 0.14
"""Share of the time that fills the range, where nobody says another."""
MOST_FILLING = 300
MOST_WAY = 0.9
"""Share of the time that may pass moving."""
REGULAR_STEPS = (45.0, 30.0, 15.0, 10.0, 5.0)
PLANE_STEPS = (30.0, 15.0, 10.0, 5.0, 2.0, 1.0)


class Read(NamedTuple):
    """What was read before, with the same instrument: rows (1, n, 1, P + Q) of it and directions (4, n), radians."""

    rows: np.ndarray
    angles: np.ndarray


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
        known: what was read before; None: nothing.
        space_filling: share of the time for directions that fill the range evenly.
        lit: the sides that the light comes from, "front", "back" or "both"; the detector goes where it is sent.
    """

    prior: Prior
    instrument: Instrument
    rival: Prior | None = None
    wanted: np.ndarray | None = None
    known: Read | None = None
    space_filling: float = FILLING
    lit: str = "front"

    def __post_init__(self) -> None:
        brdf = self.prior.brdf(self.prior.p)
        self.isotropic, self.ways = brdf.isotropic, ways_of(brdf, self.lit)
        angles = candidates(self.instrument, self.isotropic, self.ways)
        if not angles.size:
            raise GonioError("the instrument reaches no direction; give larger ranges, or a smaller shadow")
        self.candidates = self.sites(both_turning(angles, self.instrument) if self.isotropic else angles)
        self.size = self.candidates.slopes.shape[-1]
        self._fillings: dict[int, np.ndarray] = {}
        self.of_draws = None if self.prior.ranged else self.prior.shares
        rows = self.candidates.rows(np.ones(angles.shape[1]))[:1]
        self.before = np.zeros((1, *[rows.shape[-1]] * 2))
        if self.known is not None:
            self.before = gram(self.known.rows, np.ones(self.known.rows.shape[1]))
        every = (gram(rows, np.ones(angles.shape[1])) + self.before)[0, : self.size, : self.size]
        require_determined(every, self.prior.names)

    def sites(self, angles: np.ndarray) -> Sites:
        """The model at some directions (4, n)."""
        return Sites.of(self.prior, self.instrument, angles, self.prior.draws)

    def schedule(self, budget: float) -> Schedule:
        """The best shots for so many seconds."""
        settling, travel = self.instrument.pace.settling, TRAVEL
        overhead = settling + travel
        for number in range(MOST_ROUNDS):
            times = self.candidates.best_seconds(overhead, budget)
            filling, spread = self._filling(budget, settling + travel)
            share = self.space_filling if filling.seconds.size else 0.0
            many = budget * (1 - share) / (times + overhead)
            rate = self.candidates.rows(times) * np.sqrt(many)[:, None, None]
            problem = Problem(rate, self.before + spread, self.size, self.wanted, self.of_draws)
            if self.of_draws is None and self.rival is None:
                self.of_draws = balanced(problem)
                problem = problem._replace(of_draws=self.of_draws)
            if self.rival is None:
                design = optimal_design(problem)
            else:
                design = self._separating(np.sqrt(many[:, None] / self.candidates.variance(times)[0]), filling)
            chosen = self._rounded(design.shares, problem, times, ((1 - share) * budget, overhead, travel))
            both = (np.concatenate(a, axis=-1) for a in zip(chosen, filling, strict=True))
            patience = SOLVER_SECONDS if number >= ROUNDS - 1 else QUICK_SECONDS
            shots = ordered(Shots(*both), self.instrument.pace, patience)
            way = self.instrument.pace.path_seconds(shots.angles, 0.0)
            overhead = way / shots.seconds.size
            travel = (way - settling * shots.seconds.size) / np.unique(shots.angles, axis=1).shape[1]
            if number >= ROUNDS - 1 and way <= MOST_WAY * budget:
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

    def mean_variance(self, covariance: np.ndarray) -> float:
        """What a covariance loses, as a variance: of all numbers their geometric mean, but for correlation."""
        return float(np.exp(self.loss(covariance) / (self.size if self.wanted is None else 1)))

    def advantage(self, shots: Shots, others: Shots) -> float:
        """Variance of other shots over that of some, by the criterion of the plan: of all numbers their mean ratio."""
        if self.rival is not None:
            return float((self.separation(shots) / self.separation(others)) ** 2)
        return self.mean_variance(self.covariance(others)) / self.mean_variance(self.covariance(shots))

    def regular(self, budget: float) -> tuple[str, Shots] | None:
        """The best regular scan of so many seconds, and its name; None where none fits in."""
        schemes = [(f"in the plane by {s:g}°", in_plane, s) for s in PLANE_STEPS if self.isotropic]
        grid, name = (isotropic, "isotropic") if self.isotropic else (spherical, "spherical")
        schemes += [(f"{name} by {s:g}°", grid, s) for s in REGULAR_STEPS if self.isotropic or s > 10]
        through = [way for way in self.ways if way.light != way.detector]
        hemisphere = "reflection" if not through else "transmission" if through == list(self.ways) else "both"
        if self.lit == "both":
            hemisphere = "both"
        best: tuple[float, str, Shots] | None = None
        for title, make, step in schemes:
            layout = make(np.radians(step), hemisphere=hemisphere, lit=self.lit)
            angles = np.stack([np.asarray(a)[scan_order(layout)] for a in layout.angles()])
            shots = self.evenly(readable(angles, self.instrument), budget)
            if shots is None:
                continue
            try:
                loss = self.loss(self.covariance(shots)) if self.rival is None else -self.separation(shots)
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
        count = max(count, min(len(self.ways), int(time / (overhead + LEAST_SECONDS))))  # each way once, at least
        angles = self._fillings.get(count)
        if angles is None:
            read = None if self.known is None else self.known.angles
            angles = space_filling(self.instrument, self.isotropic, count, self.ways, read)
            angles = both_turning(angles, self.instrument) if self.isotropic else angles
            self._fillings[count] = angles
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
            if seconds.min() > 0 and self.rival is not None:
                value = 0.0  # shares that separate are kept as they are
            elif seconds.min() > 0:
                rows = self.candidates.part(support).rows(seconds)
                value = criterion(problem._replace(rows=rows), count.astype(float)).value
            if value > (-np.inf if best is None else best[0]):
                best = value, Shots(np.repeat(self.candidates.angles[:, support], count, axis=1), seconds.repeat(count))
            elif best is not None and value < best[0] - 1.0:
                break
            if best is not None and self.rival is not None:
                break
            keep = np.arange(support.size) != np.argmin(weights)
            support, weights = support[keep], weights[keep]
            if support.size:
                weights = best_shares(problem.part(support), weights / weights.sum())
        if best is None:
            raise GonioError(f"{_too_short(budget)} to determine all free numbers; give more time, or fewer of them")
        return best[1]

    def separation(self, shots: Shots) -> float:
        """Standard uncertainties by which some shots tell the model apart from its rival at the rival's best."""
        sites = Sites.of(self.prior, self.instrument, shots.angles, self.prior.p[None])
        return self._nearest_rival(shots.angles, sites.f[0], 1 / np.sqrt(sites.variance(shots.seconds)[0]))[1]

    def _separating(self, rate: np.ndarray, filling: Shots) -> Design:
        """The T-optimal shares; `rate`: one over the standard uncertainty (n, C) of each candidate in its time."""
        others = Sites.of(self.prior, self.instrument, filling.angles, self.prior.p[None])
        fixed = 1 / np.sqrt(others.variance(filling.seconds)[0])
        both = np.concatenate([self.candidates.angles, filling.angles], axis=1)
        f = np.concatenate([self.candidates.f[0], others.f[0]])

        def squares(shares: np.ndarray) -> tuple[np.ndarray, float]:
            weight = np.concatenate([rate * np.sqrt(shares)[:, None], fixed])
            read = np.flatnonzero(weight.max(axis=1) > 0)
            p = self._nearest_rival(both[:, read], f[read], weight[read])[0]
            assert self.rival is not None
            difference = (self.rival.at_angles(p, both)[0] - f) ** 2
            each = np.sum(difference[: rate.shape[0]] * rate**2, axis=1)
            return each, float(np.sum(difference[rate.shape[0] :] * fixed**2))

        return separating_design(squares, rate.shape[0])

    def _nearest_rival(self, angles: np.ndarray, f: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, float]:
        """(the rival's numbers of the least Σ (weight (f − rival))² in some directions, the root of that)."""
        assert self.rival is not None
        rival, d = self.rival, self.rival.parameterisation.domains
        scale = np.maximum(np.abs(rival.p), 1e-3)

        @functools.lru_cache(maxsize=1)  # the solver asks for the slopes where it has just asked for the values
        def rivals(x: bytes) -> tuple[np.ndarray, np.ndarray]:
            return rival.at_angles(np.frombuffer(x) * scale, angles)

        def residuals(x: np.ndarray) -> np.ndarray:
            return (weight * (rivals(x.tobytes())[0] - f)).ravel()

        def jacobian(x: np.ndarray) -> np.ndarray:
            slopes = rivals(x.tobytes())[1] * weight[..., None]
            return slopes.reshape(-1, scale.size) * scale

        start = np.clip(rival.p / scale, d.low / scale + 1e-9, d.high / scale - 1e-9)
        end = least_squares(residuals, start, jac=jacobian, bounds=(d.low / scale, d.high / scale))  # pyright: ignore[reportArgumentType]
        return end.x * scale, float(np.sqrt(2 * end.cost))


def _too_short(budget: float) -> str:
    return f"a budget of {budget:.3g} s is too short"
