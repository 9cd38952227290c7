"""Tests of many readings at once, at a stated level of the whole family, where a reading may be a count of photons.

A family of n tests has the level α if each is made at 1 − (1 − α)^(1/n) [Šidák 1967]; for normal deviates, of whatever
correlation, the family's level is then at most α. Tails of counts are heavier than a normal deviate's, just where n
is large: they come from the cumulant generating function of the counts [Lugannani & Rice 1980, with the lattice
correction of Daniels 1987].
"""

import numpy as np

from gonio.checks.table.statistics.cumulants import Generating, standard_counts, tilts
from gonio.models.special.scipy_functions import exprel, gammainc, log_ndtr, ndtr, ndtri

LIKELY = 2.5
"""Differences of fewer standard deviations take the normal tail."""

FARTHEST = 36.0
"""Differences of more standard deviations are as improbable as these, 1e-283: no double precision holds much less."""

RARE = 10.0
"""Counts of so many standard deviations each, a hundredth of one expected in all, have the tail of Poisson's law."""

NEARLY = 0.3
"""Share of a count by which the size of a count may be too large."""

MANY = 20
"""With fewer different values their rounding cannot be known."""


def sidak(level: float, tests: int) -> float:
    """The level of each of some tests for a family of `level`."""
    return float(-np.expm1(np.log1p(-level) / max(tests, 1)))


def family_p(p: np.ndarray | float, tests: np.ndarray | int) -> np.ndarray:
    """The p-value of a family of tests whose smallest is p."""
    return -np.expm1(tests * np.log1p(-np.minimum(p, 1 - 1e-16)))


def critical(p: float) -> float:
    """Standard normal deviate that is exceeded on either side with the probability p."""
    return float(-ndtri(p / 2))


def decimal_step(values: np.ndarray) -> float:
    """The decimal to which readings, (n,), were rounded when they were written down (0.001, say), or 0 for none.

    Few different values are taken for round numbers, not for rounded ones.
    """
    some = np.unique(values[np.isfinite(values)])
    if some.size < MANY:
        return 0.0
    some = some[:: max(1, some.size // 2000)]
    for digits in range(10):
        scaled = some * 10.0**digits
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-11 * np.abs(scaled) + 1e-12):
            return 10.0**-digits
    return 0.0


def difference_p(
    a: np.ndarray,
    b: np.ndarray,
    u_a: np.ndarray,
    u_b: np.ndarray,
    q_a: np.ndarray,
    q_b: np.ndarray,
    allowed: np.ndarray | float,
) -> np.ndarray:
    """Two-sided p-values, (n,), of |a − b| − allowed for readings that are expected to be the same.

    u are standard uncertainties of the expected readings, q the sizes of a count, all (n,).
    """
    x = np.maximum(np.abs(a - b) - allowed, 0.0)
    z = x / np.sqrt(u_a**2 + u_b**2)
    p = 2 * ndtr(-z)
    far = np.flatnonzero(z > LIKELY)
    if far.size:
        x, u_a, u_b, q_a, q_b, a, b = (v[far] for v in (x, u_a, u_b, q_a, q_b, a, b))
        mean = np.maximum((a * u_b**2 + b * u_a**2) / (u_a**2 + u_b**2), 0.0)
        up = _tail(x, u_a, u_b, q_a, q_b, mean)
        down = _tail(x, u_b, u_a, q_b, q_a, mean)
        p[far] = np.clip(up + down, p[far], 1.0)
    return p


def _tail(
    x: np.ndarray, u_up: np.ndarray, u_down: np.ndarray, q_up: np.ndarray, q_down: np.ndarray, mean: np.ndarray
) -> np.ndarray:
    # Of counts up by q_up and down by q_down; what the signal does not explain counts both ways (dark counts do).
    sigma = np.hypot(u_up, u_down)
    rare = q_up > RARE * sigma
    counts = np.maximum(np.floor(np.divide(x, q_up, out=np.ones_like(x), where=rare) + NEARLY), 1.0)
    of_rare = gammainc(counts, np.divide(u_up, q_up, out=np.ones_like(x), where=rare) ** 2)
    x = np.minimum(x / sigma, FARTHEST)
    q_up, q_down = (np.minimum(q, RARE * sigma) for q in (q_up, q_down))
    v, q = standard_counts(u_up, u_down, q_up, q_down, mean)
    q_up, q_down = q[0], q[2]
    whole = Generating(np.ones(x.size, int), np.stack(v), np.stack(q))
    t = tilts(whole, x)
    w = np.sqrt(np.maximum(2 * (t * x - whole.value(t)), 1e-12))
    u = t * np.sqrt(whole.tilted(t)[1]) * exprel(-np.maximum(q_up, q_down) * t)
    many = ndtr(-w) + np.exp(-(w**2) / 2) / np.sqrt(2 * np.pi) * (1 / u - 1 / w)
    return np.where(rare, of_rare, many)


def deviates(p: np.ndarray) -> np.ndarray:
    """Standard normal deviates of two-sided p-values, also of such as underflow no more than 1e-300."""
    return -ndtri(np.maximum(p, 1e-300) / 2)


def normal_p(z: np.ndarray) -> np.ndarray:
    """Two-sided p-values of standard normal deviates."""
    return np.minimum(2 * np.exp(log_ndtr(-np.abs(z))), 1.0)
