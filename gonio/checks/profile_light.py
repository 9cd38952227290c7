"""The light of a profile: ∫∫R dA between its readings and, by their slopes, where nothing was read."""

from typing import NamedTuple

import numpy as np

from gonio.data.profile import Profile
from gonio.models.display import percent

STEPS = 4000
LAST = 4
"""Part of the distances, the last of them, whose slope says what is beyond."""
FEWEST = 3
"""Distances with light, of which an integral is made."""


class ByDistance(NamedTuple):
    """Readings (n, channels) by the distance (n,), both sides averaged: values, uncertainties, NaN where none is."""

    r: np.ndarray
    value: np.ndarray
    u: np.ndarray


class ProfileLight(NamedTuple):
    """∫∫R dA of a channel as if all light left with the radiance along the normal, and a bound on its error.

    `within` (m,) is what leaves within r (m,), mm; `unread` says where nothing was read.
    """

    total: float
    bound: float
    unread: str
    r: np.ndarray
    within: np.ndarray


def by_distance(profile: Profile) -> ByDistance:
    """The readings of both sides together."""
    r, which = np.unique(np.abs(profile.offsets), return_inverse=True)
    value, variance, count = (np.zeros((r.size, len(profile.channels))) for _ in range(3))
    np.add.at(value, which, np.where(profile.valid, profile.value, 0.0))
    np.add.at(variance, which, np.where(profile.valid, np.nan_to_num(profile.u), 0.0) ** 2)
    np.add.at(count, which, profile.valid)
    with np.errstate(invalid="ignore", divide="ignore"):
        return ByDistance(r, value / count, np.sqrt(variance) / count)


def light_of_profile(side: ByDistance, c: int, factor: float) -> ProfileLight | None:
    """The light of a channel; None where fewer than `FEWEST` distances have any.

    `factor`: how many standard uncertainties count, of a reading that is light, and in the bound.
    """
    use = np.isfinite(side.value[:, c]) & (side.value[:, c] > factor * side.u[:, c])
    # Where noise is as large as the reading the profile ends: what is beyond is a matter of its slope.
    use &= np.cumprod(use[np.argmax(use) :].astype(bool)).astype(bool).sum() + np.argmax(use) > np.arange(use.size)
    r, value, u = side.r[use], side.value[use, c], side.u[use, c]
    if r.size < FEWEST:
        return None

    from scipy import integrate, interpolate  # a fifth of a second, which checks of tables and models do not need

    fine = np.linspace(r[0], r[-1], STEPS)
    scale = np.min(np.diff(r))

    def between(every: slice, by_factors: bool = False) -> np.ndarray:
        x, y, places = r[every], np.log(value[every]), fine
        if by_factors:
            x, places = np.log(x + scale), np.log(fine + scale)
        curve = interpolate.PchipInterpolator(x, y) if x.size > 2 else interpolate.interp1d(x, y, bounds_error=False)
        exitance = 2 * np.pi * fine * np.exp(np.nan_to_num(curve(places), nan=-np.inf))
        return integrate.cumulative_trapezoid(exitance, fine, initial=0.0)

    inner, edge = between(slice(None)), np.pi * r[0] ** 2 * value[0]
    read = float(inner[-1])
    others = [between(slice(None), True)] + [between(slice((r.size - 1) % 2, None, 2))] * (r.size > 4)
    off = max(abs(read - float(other[-1])) for other in others)
    relative = factor * u / value
    centre, most_within = _within_first(r, value, relative)
    if r[0] == 0:
        off = max(off, _most_beside_centre(r, value, relative) - float(np.interp(r[1], fine, inner)))
    noise = factor * float(np.sqrt(np.sum((2 * np.pi * r * np.gradient(r) * u) ** 2)))
    low, high = _tail(r, value, relative)
    tail = (low + high) / 2 if np.isfinite(high) else low
    bound = off + (most_within - edge) + (high - tail) + noise
    parts = [f"nothing was read beyond {r[-1]:.3g} mm ({_more(low, high, max(read, 1e-300))})"]
    if r[0] > 0:
        parts.append(f"nor within {r[0]:.3g} mm ({percent(centre / max(read, 1e-300))})")
    total = read + centre + tail
    return ProfileLight(float(total), float(bound), f"Not looked at: {', '.join(parts)}.", fine, centre + inner)


def _within_first(r: np.ndarray, value: np.ndarray, relative: np.ndarray) -> tuple[float, float]:
    """The light within the first distance, and the most of it: nearer to the light R falls less steeply than there."""
    edge = float(np.pi * r[0] ** 2 * value[0])
    if r[0] == 0:
        return 0.0, 0.0
    fall, error = float(np.log(value[0] / value[1])), float(np.hypot(*relative[:2]))
    likely, most = (max(f / float(np.log(r[1] / r[0])), 0.0) for f in (fall, fall + error))
    return edge * 2 / (2 - likely) if likely < 2 else edge, edge * 2 / (2 - most) if most < 2 else np.inf


def _most_beside_centre(r: np.ndarray, value: np.ndarray, relative: np.ndarray) -> float:
    """The most light within the first distance beyond 0: of the power by which R falls there, as bright as at 0."""
    fall = float(np.log(value[1] / value[2]) + np.hypot(*relative[1:3]))
    power = max(fall / float(np.log(r[2] / r[1])), 0.0)
    edges = r[1] * np.geomspace(1e-4, 1, STEPS)
    exitance = np.minimum(value[0], value[1] * (r[1] / edges) ** power)
    return float(np.pi * np.sum(np.diff(edges**2, prepend=0.0) * exitance))


def _tail(r: np.ndarray, value: np.ndarray, relative: np.ndarray) -> tuple[float, float]:
    """The least and the most light beyond the last distance, by the slope of the last readings, to their `relative`
    errors.

    Diffused light falls more slowly than an exponential that meets it, and faster than such a power of the distance:
    its sources lie at all depths, and what travels farther is absorbed more. No bound where that power is 2 or less.
    """
    start = r.size - max(2, r.size // LAST)
    start -= r[start] == 0
    fall = float(np.log(value[start] / value[-1]))
    error = float(np.hypot(relative[start], relative[-1]))
    rate = (fall + error) / (r[-1] - r[start])
    low = 2 * np.pi * value[-1] * (r[-1] / rate + 1 / rate**2) if rate > 0 else 0.0
    power = (fall - error) / float(np.log(r[-1] / r[start])) if r[start] > 0 else 0.0
    high = 2 * np.pi * value[-1] * r[-1] ** 2 / (power - 2) if power > 2 else np.inf
    return float(low), float(max(high, low))


def _more(low: float, high: float, read: float) -> str:
    if not np.isfinite(high):
        return f"at least {percent(low / read)} more by the last slope, and no bound on it; read further out"
    more = f"{percent(low / read)} to {percent(high / read)} more"
    return f"{more}, if R falls on between the exponential and the power of its last slope"
