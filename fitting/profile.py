"""Intervals of numbers known so vaguely that their cost is no parabola: profile likelihood [James & Roos 1975].

A number is held at a value and all others are fitted again; its interval ends where the cost has risen by what 95 %
confidence allows. In a valley that bends, the covariance at its bottom says little about its ends.
"""

import dataclasses

import numpy as np

from gonio.fitting.descents import descend_all
from gonio.fitting.domains import LINEAR, LOG, Domains
from gonio.fitting.uncertainty import FACTOR_OPEN, NORMAL_95, WIDE_OPEN, Covariance, open_from

VAGUE = 0.15  # of the standard uncertainty that counts as open, from which on the profile is followed
ALONG = 0.95  # correlation of numbers that go together
CLOSE = 0.03  # relative error of an interval's end
TRIALS = 10
HELD = 1e-9  # of a number: the width of the domain that holds it
FAR = 3.0  # standard deviations, and the factor of e to this power that is open there: for a parabola, the same thing
FAR_OPEN = FACTOR_OPEN * FAR / NORMAL_95
MOST = 6  # numbers that are followed


def with_profiles(e):
    """The ending with profile intervals of its vague numbers, those that are open after all called undetermined."""
    u, reach = e.covariance.standard, open_from(e.domains, e.p)
    with np.errstate(invalid="ignore"):
        vague = (u > VAGUE * reach) & ~e.pinned
        # What goes with a vague number is as vague in its own size, however small that is beside its domain.
        along = (np.abs(e.covariance.correlation) > ALONG)[:, vague].any(axis=1) & (u > VAGUE * np.abs(e.p) / 2)
    vague = np.flatnonzero(vague | (along & ~e.pinned))
    if not vague.size or e.exact or not e.converged:
        return e
    found, covariance = {}, e.covariance
    for k in vague[np.argsort(-(u / reach)[vague])][:MOST]:
        k = int(k)
        ends = (float(_end(e, k, -1.0)), float(_end(e, k, 1.0)))
        if not all(np.isfinite(ends)):
            continue
        found[k] = ends
        value = float(e.p[k])
        far = ends
        if not (opened := is_open(e.domains, k, ends, value)):
            # Noise may seem to decide where a bent valley hardly does: three standard deviations see its far side.
            far = (float(_end(e, k, -1.0, FAR)), float(_end(e, k, 1.0, FAR)))
            opened = all(np.isfinite(far)) and is_open(e.domains, k, far, value, FAR_OPEN)
        if opened:
            covariance = _opened(covariance, k, far, reach, e.p)
    return dataclasses.replace(e, profile=found, covariance=covariance)


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
    vague = np.sqrt(np.nan_to_num(np.diagonal(c.matrix))) > VAGUE * np.minimum(reach, np.abs(p))
    undetermined |= alike & vague
    same = [v for v, other in c.combinations if _parallel(change / reach, other / reach)]
    return Covariance(c.matrix, undetermined, c.combinations if same else [*c.combinations, (variance, change)])


def _parallel(a: np.ndarray, b: np.ndarray) -> bool:
    return abs(float(a @ b)) > 0.9 * float(np.linalg.norm(a) * np.linalg.norm(b))


def _end(e, k: int, sign: float, deviations: float = NORMAL_95) -> float:
    """Where the profile of number k has risen by what so many standard deviations allow, below (−1) or above (1) its
    value; its bound where it never does; NaN where a fit fails.
    """
    value, bound = float(e.p[k]), float(e.domains.low[k] if sign < 0 else e.domains.high[k])
    variance = float(e.covariance.matrix[k, k])
    column = np.nan_to_num(e.covariance.matrix[:, k]) / variance
    allowed = 0.5 * deviations**2 * _unit(e, k)
    base = float(e.total.cost)
    away = min(deviations * np.sqrt(variance), abs(bound - value))
    within, beyond = (0.0, 0.0), None
    start = e.p
    for _ in range(TRIALS):
        if away <= 0:
            return bound
        held = value + sign * away
        straight = np.clip(e.p + sign * away * column, e.domains.low, e.domains.high)
        p, cost = _held(e, k, held, [start, straight])
        if not np.isfinite(cost):
            return float("nan")
        rise = np.sqrt(max(cost - base, 0.0) / allowed)
        if abs(rise - 1.0) < CLOSE:
            return held
        if rise < 1.0:
            within, start = (away, rise), p
            if away >= abs(bound - value) * (1 - 1e-12):
                return bound
        else:
            beyond = (away, rise)
        if beyond is None:
            # A rise that slows down would be chased for ever: at most three times as far at once.
            away = min(away * min(3.0, 1.0 / max(rise, 1e-3)), abs(bound - value))
        else:
            (a, rise_a), (b, rise_b) = within, beyond
            share = np.clip((1.0 - rise_a) / (rise_b - rise_a), 0.1, 0.9)
            away = a + share * (b - a)
    return value + sign * away


def _held(e, k: int, value: float, guesses: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """(numbers, cost) of the fit with number k held, the best from the guesses.

    It is held by a domain that leaves it no room: nothing compiles again.
    """
    low, high = np.array(e.domains.low, float), np.array(e.domains.high, float)
    room = HELD * max(abs(value), 1e-3 * min(high[k] - low[k], 1.0))
    low[k], high[k] = max(low[k], value - room), min(high[k], value + room)
    domains = e.domains._replace(low=low, high=high)
    starts = [np.where(np.arange(g.size) == k, 0.5 * (low[k] + high[k]), g) for g in guesses]
    ends = descend_all(dataclasses.replace(e.problem, domains=domains), domains, starts, near=True)
    best = min(ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)
    return best.p, best.cost


def _unit(e, k: int) -> float:
    """Variance of number k over that of a unit noise: 1 where the noise is known."""
    at = np.flatnonzero(np.isfinite(np.diagonal(e.covariance.matrix)))
    matrix = np.asarray(e.total.matrix)[np.ix_(at, at)]
    lengths = np.sqrt(np.diagonal(matrix))
    inverse = np.linalg.pinv(matrix / np.outer(lengths, lengths), rcond=1e-14, hermitian=True)
    place = int(np.flatnonzero(at == k)[0])
    return float(e.covariance.matrix[k, k] / (inverse[place, place] / lengths[place] ** 2))
