"""Directions that fill an instrument's range: none that it can read is far from all of them.

Two directions are as far apart as what a surface does there may differ: light and detector may be exchanged where the
same light goes the way back, and an isotropic surface is the same at every azimuth of both together, and mirrored.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gonio.instrument.instrument import Instrument
from gonio.models.geometry.low_discrepancy import low_discrepancy
from gonio.planning.candidates import Angles, highest, readable
from gonio.planning.ways import Way

REFLECTED = Way()
POOL, MOST_POOL, LEAST_POOL = 64, 6000, 16
"""Directions of the range for each of those that fill it; of them all, but for so many for each."""
SWEEPS = 6
MOST_READ = 5000
"""Readings taken before that are looked at: more of them leave no hole that these do not show."""


def anywhere(instrument: Instrument, isotropic: bool, count: int, way: Way = REFLECTED) -> Angles:
    """`count` directions, even over the solid angles of light and detector, less those that cannot be read."""
    low_i, low_o = (math.cos(t) for t in highest(instrument))
    u = low_discrepancy(count, 4, skip=1)
    polar = (np.arccos(1 - u[:, k] * (1 - low)) for k, low in ((0, low_i), (2, low_o)))
    theta_i, theta_o = polar
    every = np.stack([theta_i, u[:, 1] * 2 * np.pi, theta_o, u[:, 3] * 2 * np.pi])
    return readable(way.unfolded(every), instrument, isotropic)


def space_filling(
    instrument: Instrument,
    isotropic: bool,
    count: int,
    ways: Sequence[Way] = (REFLECTED,),
    read: Angles | None = None,
) -> Angles:
    """At most `count` directions (4, n), radians, each amid its share of the range, equally many on each of the ways.

    They are the centres of a centroidal tessellation of the range [Lloyd 1982; Du, Faber & Gunzburger 1999]. Directions
    that were `read` before, (4, m), are centres that stay where they are: the others fill what these leave.
    """
    counts = [count // len(ways) + (k < count % len(ways)) for k in range(len(ways))]
    each = [_centres(instrument, isotropic, n, way, _some(read)) for n, way in zip(counts, ways, strict=True) if n]
    return np.concatenate([np.zeros((4, 0)), *each], axis=1)


def squared_distances(one: Angles, other: Angles, isotropic: bool, reciprocal: bool = True) -> Float[np.ndarray, "n m"]:
    """Squared chords between the lights plus those between the detectors, least over what leaves a surface the same.

    Args:
        one, other: directions (4, n) and (4, m), radians.
        isotropic: whether a surface is the same at every azimuth, and mirrored.
        reciprocal: whether light and detector may be exchanged.
    """
    theta_i, phi_i, theta_o, phi_o = one
    if reciprocal:
        exchanged = np.stack([theta_o, phi_o, theta_i, phi_i])
        both = (squared_distances(a, other, isotropic, False) for a in (one, exchanged))
        return np.minimum(*both)
    along_i, along_o = (np.outer(np.cos(one[k]), np.cos(other[k])) for k in (0, 2))
    across_i, across_o = (np.outer(np.sin(one[k]), np.sin(other[k])) for k in (0, 2))
    if isotropic:
        turns = (np.abs((a[3] - a[1] + np.pi) % (2 * np.pi) - np.pi) for a in (one, other))
        cosine = np.cos(np.subtract.outer(*turns))
        across = np.sqrt(np.maximum(across_i**2 + across_o**2 + 2 * across_i * across_o * cosine, 0.0))
    else:
        cosines = (np.cos(np.subtract.outer(a, b)) for a, b in ((phi_i, other[1]), (phi_o, other[3])))
        cos_i, cos_o = cosines
        across = across_i * cos_i + across_o * cos_o
    return np.maximum(2 * (2 - along_i - along_o - across), 0.0)


def _some(read: Angles | None) -> Angles:
    """At most `MOST_READ` of the directions, any of them."""
    if read is None:
        return np.zeros((4, 0))
    size = read.shape[1]
    return read if size <= MOST_READ else read[:, np.random.default_rng(0).choice(size, MOST_READ, replace=False)]


def _centres(instrument: Instrument, isotropic: bool, count: int, way: Way, read: Angles) -> Angles:
    size = max(min(POOL * count, MOST_POOL), LEAST_POOL * count)
    pool = anywhere(instrument, isotropic, size, way)
    exchanged = pool[[2, 3, 0, 1]]
    fold = (pool[0] > pool[2]) & way.reciprocal & _exchangeable(instrument, isotropic)
    # The steeper light gives more counts, and half the range is a shorter way.
    pool = readable(np.where(fold, exchanged, pool), instrument, isotropic)
    if not pool.size:
        return pool
    before = squared_distances(pool, read, isotropic, way.reciprocal).min(axis=1, initial=np.inf)
    places = _farthest(pool, before, count, isotropic, way)
    for _ in range(SWEEPS):
        distances = squared_distances(pool, places, isotropic, way.reciprocal)
        cell = np.where(distances.min(axis=1) < before, np.argmin(distances, axis=1), -1)
        members = [pool[:, cell == k] for k in range(places.shape[1])]
        centres = [
            m[:, np.argmin(squared_distances(m, m, isotropic, way.reciprocal).sum(axis=1))] for m in members if m.size
        ]
        places = np.stack(centres, axis=1) if centres else np.zeros((4, 0))
        if not centres:
            break
    return places


def _farthest(pool: Angles, before: Float[np.ndarray, " n"], count: int, isotropic: bool, way: Way) -> Angles:
    """Directions of the pool, each the farthest from all that were read or chosen before [Gonzalez 1985]."""
    nearest, chosen = before, []
    for _ in range(min(count, pool.shape[1])):
        chosen.append(int(np.argmax(nearest)))
        one = squared_distances(pool, pool[:, chosen[-1:]], isotropic, way.reciprocal)[:, 0]
        nearest = np.minimum(nearest, one)
    return pool[:, chosen]


def _exchangeable(instrument: Instrument, isotropic: bool) -> bool:
    """Whether light and detector go to the same places."""
    most_i, most_o = highest(instrument)
    (polar_i, azimuth_i), (polar_o, azimuth_o) = instrument.ranges[:2], instrument.ranges[2:]
    return most_i == most_o and polar_i == polar_o and (isotropic or azimuth_i == azimuth_o)
