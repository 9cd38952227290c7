"""Intervals of σa and σs' by the profile likelihood [Venzon & Moolgavkar 1988], where the cost is no parabola.

One number is fixed and the other one fitted again; an interval ends where the cost has risen by what is allowed. Other
optima of nearly the same cost are within it too. Light without absorption is the end of what there is, and the cost may
have a slope there.
"""

import dataclasses
from typing import NamedTuple

import jax
import numpy as np

from gonio.fitting.subsurface.problem import LeastSquares, ProfileOptimum, polished
from gonio.models.subsurface.base import MOST

TRIALS = 20
CLOSE = 0.03
"""Relative error of the allowed rise at an end, in standard deviations."""
ENOUGH = 1e-3
"""Of the allowed rise: what a fit with a number fixed may leave."""
FIRST = (0.02, 0.1)
"""Distances of the first trial at least: of the root, and of the logarithm."""
FURTHEST = np.array([np.sqrt(MOST), np.log(MOST)])


class Interval(NamedTuple):
    """Ends of one number."""

    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class _Follower:
    """The cost along one number of x, the other one fitted."""

    problem: LeastSquares
    k: int
    best: float
    allowed: float
    absorbing: float
    """√σa that the readings would tell from 0."""

    def rise(self, value: float, start: np.ndarray) -> tuple[float, np.ndarray]:
        """Rise of the cost over the allowed one, as a root, with number k at a value; x there."""
        x = start.copy()
        x[self.k] = value
        other = self.problem.free & (np.arange(2) != self.k)
        if other[0] and abs(x[0]) < self.absorbing:
            x[0] = self.absorbing  # at the kink of no absorption nothing tells the way
        there, residual, _ = polished(self.problem, x, other, ENOUGH * self.allowed)
        ends = [(float(residual @ residual), there)]
        if other[0]:
            clear = np.array([0.0, x[1]])
            ends.append((self.problem.cost(clear), clear))
        cost, x = min(ends, key=lambda end: end[0])
        return float(np.sqrt(max(cost - self.best, 0.0) / self.allowed)), x

    def end(self, x: np.ndarray, sign: int, distance: float) -> float:
        """Where the cost has risen by what is allowed, from x on to one side."""
        origin, furthest = float(x[self.k]), sign * FURTHEST[self.k]
        if self.k == 0:
            origin, furthest = abs(origin), max(furthest, 0.0)
        room = abs(furthest - origin)
        within, beyond = (0.0, self.rise(origin, x)[0]), None
        distance = min(distance, room)
        for _ in range(TRIALS):
            if distance <= 0:
                break
            risen, there = self.rise(origin + sign * distance, x)
            if abs(risen - 1) < CLOSE or (risen < 1 and distance >= room):
                return origin + sign * distance
            if risen > 1 or not np.isfinite(risen):
                beyond = (distance, min(risen, 10.0) if np.isfinite(risen) else 10.0)
            else:
                within, x = (distance, risen), there
            if beyond is None:
                distance = min(2.5 * distance, room)
            else:
                share = (1 - within[1]) / max(beyond[1] - within[1], 1e-12)
                distance = within[0] + float(np.clip(share, 0.1, 0.9)) * (beyond[0] - within[0])
        return origin + sign * (within[0] if beyond is None else beyond[0])


def profile_intervals(problem: LeastSquares, o: ProfileOptimum, allowed: float, reach: np.ndarray) -> list[Interval]:
    """Intervals of √σa and ln σs', over which the cost rises by no more than `allowed`.

    Args:
        problem: the least squares of one channel.
        o: its optimum, with the other ones that the search met.
        allowed: rise of the cost.
        reach: half lengths (2,) of the intervals of a parabola, where the search begins.
    """
    x = np.array([o.root, o.x[1]])
    near = [end for end in o.others if problem.cost(end) <= o.cost + allowed]
    made = []
    with jax.enable_x64(True):
        for k in range(2):
            if not problem.free[k]:
                made.append(Interval(x[k], x[k]))
                continue
            follower = _Follower(problem, k, o.cost, allowed, max(float(np.nan_to_num(reach[0], posinf=0.0)), FIRST[0]))
            step = max(float(np.nan_to_num(reach[k], posinf=0.0)), FIRST[k])
            ends = [follower.end(x, sign, step) for sign in (-1, 1)]
            for other in near:
                value = abs(other[0]) if k == 0 else other[1]
                if value < ends[0]:
                    ends[0] = follower.end(np.array([abs(other[0]), other[1]]), -1, step)
                elif value > ends[1]:
                    ends[1] = follower.end(np.array([abs(other[0]), other[1]]), 1, step)
            made.append(Interval(*ends))
    return made
