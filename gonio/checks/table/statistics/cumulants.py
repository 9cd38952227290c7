"""Cumulant generating functions of sums of counts, and the tilts at which they have given means."""

import numpy as np

from gonio.models.special.scipy_functions import exprel

STEPS = 100
"""Five or six are usual, 50 the most that are needed."""
ENOUGH = 1e-9
"""Of the tilt of a sum, at which its tail is stationary."""
LARGEST_POWER = 600.0
"""Its exponential is 1e260."""
NEWTON = 1e-5
"""Of the tilt: the next of Newton's steps would be about its square."""


def standard_counts(
    u_up: np.ndarray, u_down: np.ndarray, q_up: np.ndarray, q_down: np.ndarray, mean: np.ndarray
) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Variances and sizes of the counts of a difference, in its standard deviations; half of the sizes are falls."""
    sigma = np.hypot(u_up, u_down)
    mean = mean / sigma
    q_up, q_down = q_up / sigma, q_down / sigma
    v_up, v_down = (u_up / sigma) ** 2, (u_down / sigma) ** 2
    s_up, s_down = np.minimum(v_up, q_up * mean), np.minimum(v_down, q_down * mean)
    v = (s_up + (v_up - s_up) / 2, (v_up - s_up) / 2, (v_down - s_down) / 2, s_down + (v_down - s_down) / 2)
    return v, (q_up, -q_up, q_down, -q_down)


class Generating:
    """The cumulant generating functions of some sums, in their standard deviations."""

    def __init__(self, sizes: np.ndarray, v: np.ndarray, q: np.ndarray) -> None:
        """Of sums of so many differences (R,), whose counts have variances v and sizes q, (4, n): a rise, its fall."""
        self._sum = np.repeat(np.arange(sizes.size), sizes)
        self._starts, self.v, self.q = np.cumsum(sizes) - sizes, v, q

    def where(self, some: np.ndarray) -> "Generating":
        """Those of some of the sums, a mask."""
        rows = some[self._sum]
        sizes = np.bincount(self._sum, minlength=some.size)[some]
        return Generating(sizes, self.v[:, rows], self.q[:, rows])

    def tilted(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative at t, (R,) each."""
        y = self.q[::2] * t[self._sum]
        mean = exprel(y)
        rise = 1 + y * mean  # exp y; a fall has the size of a rise
        up, down = self.v[::2], self.v[1::2] / rise
        return t * self._total((up + down) * mean), self._total(up * rise + down)

    def value(self, t: np.ndarray) -> np.ndarray:
        """At t, (R,)."""
        return t**2 * self._total(self.v * _second_order(self.q * t[self._sum]))

    def largest(self) -> np.ndarray:
        """The largest size of a count of each sum, (R,)."""
        return np.maximum.reduceat(self.q.max(axis=0), self._starts)

    def _total(self, values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values.sum(axis=0), self._starts)


def tilts(whole: Generating, x: np.ndarray) -> np.ndarray:
    """Where the slopes are x, (R,): by Newton's steps while each is half the last, else by bisection.

    Where no tilt reaches x, as with counts that can only fall, it is the largest tilt that double precision allows.
    """
    largest, out = whole.largest(), np.empty(x.size)
    most = LARGEST_POWER / np.maximum(largest, 1e-3)
    # Where all counts have the largest size this is the root.
    t = np.minimum(np.log1p(x * largest) / np.maximum(largest, 1e-9), most)
    low, high, step, place = np.zeros(x.size), most, most, np.arange(x.size)
    for _ in range(STEPS):
        first, slope = whole.tilted(t)
        below = first < x
        low, high = np.where(below, t, low), np.where(below, high, t)
        newton = np.divide(x - first, slope, out=np.full(t.size, np.inf), where=(slope > 0) & np.isfinite(slope))
        fast = (low <= t + newton) & (t + newton <= high) & (2 * np.abs(newton) <= np.abs(step))
        step = np.where(fast, newton, (low + high) / 2 - t)
        t = t + step
        out[place] = t
        go = np.abs(step) > np.where(fast, NEWTON, ENOUGH) * np.abs(t)
        if not go.any():
            break
        if not go.all():
            whole, place = whole.where(go), place[go]
            t, low, high, step, x = (v[go] for v in (t, low, high, step, x))
    return out


def _second_order(y: np.ndarray) -> np.ndarray:
    """(exp y − 1 − y)/y²."""
    small = np.abs(y) < 1e-3
    safe = np.where(small, 1.0, y)
    return np.where(small, 0.5 + y / 6 + y**2 / 24, (np.expm1(safe) - safe) / safe**2)
