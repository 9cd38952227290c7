"""The light of a profile: ∫∫R dA between its readings and, by their slopes, where nothing was read."""

from typing import NamedTuple

import numpy as np

from gonio.data.profile import Profile
from gonio.models.display import percent

STEPS = 4000
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

    def between(every: slice) -> np.ndarray:
        x, y = r[every], np.log(value[every])
        curve = interpolate.PchipInterpolator(x, y) if x.size > 2 else interpolate.interp1d(x, y, bounds_error=False)
        exitance = 2 * np.pi * fine * np.exp(np.nan_to_num(curve(fine), nan=-np.inf))
        return integrate.cumulative_trapezoid(exitance, fine, initial=0.0)

    inner, edge = between(slice(None)), np.pi * r[0] ** 2 * value[0]
    read = float(inner[-1])
    coarse = float(between(slice((r.size - 1) % 2, None, 2))[-1]) if r.size > 4 else 0.0
    first = np.clip(np.log(value[1] / value[0]) / np.log(r[1] / r[0]), -1.9, 0.0) if r[0] > 0 else 0.0
    centre = float(2 * edge / (2 + first))
    rate = float(np.log(value[-2] / value[-1]) / (r[-1] - r[-2]))
    tail = 2 * np.pi * value[-1] * (r[-1] / rate + 1 / rate**2) if rate > 0 else np.inf
    noise = factor * float(np.sqrt(np.sum((2 * np.pi * r * np.gradient(r) * u) ** 2)))
    bound = abs(read - coarse) + (centre - edge) + tail + noise
    parts = [f"nothing was read beyond {r[-1]:.3g} mm ({percent(tail / max(read, 1e-300))} more by the last slope)"]
    if r[0] > 0:
        parts.append(f"nor within {r[0]:.3g} mm ({percent(centre / max(read, 1e-300))})")
    total = read + centre + (tail if np.isfinite(tail) else 0.0)
    return ProfileLight(float(total), float(bound), f"Not looked at: {', '.join(parts)}.", fine, centre + inner)
