"""Directions that a plan may choose from, and those that fill all of the instrument's range evenly."""

import math
from collections.abc import Sequence

import numpy as np

from gonio.instrument.instrument import Instrument
from gonio.instrument.scans import THETA_MAX
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy
from gonio.planning.ways import Way

Angles = np.ndarray
"""theta_i, phi_i, theta_o, phi_o, radians: shape (4, n)."""
ANYWHERE, NEAR_MIRROR, IN_PLANE = 800, 2400, 60
TILTS = (math.radians(0.1), math.radians(60.0))
"""Tilts of the facets that mirror the light to the detector, even in their logarithm: lobes of any width are met."""
DECIMALS = 3
"""Of the angles in degrees: what an instrument can be told."""


def candidates(instrument: Instrument, isotropic: bool, ways: Sequence[Way] = (Way(),)) -> Angles:
    """Directions anywhere, about where facets send light, and in the plane of incidence, as far as they can be read.

    Isotropic surfaces are lit from one azimuth and seen on one side of the plane of incidence.
    """
    every = [readable(_candidates(instrument, isotropic, way), instrument, isotropic) for way in ways]
    return np.unique(np.concatenate(every, axis=1), axis=1)


def _candidates(instrument: Instrument, isotropic: bool, way: Way) -> Angles:
    more = 1 if isotropic else 2
    most_i, most_o = highest(instrument)
    u = low_discrepancy(ANYWHERE * more, 4)
    anywhere = np.stack([u[:, 0] * most_i, u[:, 1] * 2 * np.pi, u[:, 2] * most_o, u[:, 3] * 2 * np.pi])
    u = low_discrepancy(NEAR_MIRROR * more, 4)
    light = np.stack([u[:, 0] * most_i, u[:, 1] * 2 * np.pi])
    tilt = TILTS[0] * (TILTS[1] / TILTS[0]) ** u[:, 2]
    facet = from_spherical(tilt, u[:, 3] * 2 * np.pi, np)
    near = np.concatenate([light, way.sent(light, facet)])
    polar, turns = np.linspace(0, most_i, IN_PLANE), np.arange(1 if isotropic else 24) * np.pi / 12
    grid = np.stack([a.ravel() for a in np.meshgrid(polar, turns)])
    normal = Direction(*(np.full(grid.shape[1], c) for c in (0.0, 0.0, 1.0)))
    mirror = np.concatenate([grid, way.sent(grid, normal)])
    steps = np.stack([a.ravel() for a in np.meshgrid(polar[::6], turns[::3], np.linspace(-most_o, most_o, IN_PLANE))])
    across = np.stack([steps[0], steps[1], np.abs(steps[2]), steps[1] + np.where(steps[2] > 0, np.pi, 0.0)])
    every = np.concatenate([anywhere, near, mirror, across], axis=1)
    return way.unfolded(every[:, every[2] < np.pi / 2])


def space_filling(instrument: Instrument, isotropic: bool, count: int, ways: Sequence[Way] = (Way(),)) -> Angles:
    """At most `count` directions, even over the solid angles of light and detector, by turns on each of the ways."""
    low_i, low_o = (math.cos(t) for t in highest(instrument))
    u = low_discrepancy(2 * count, 4, skip=1)
    polar = (np.arccos(1 - u[:, k] * (1 - low)) for k, low in ((0, low_i), (2, low_o)))
    theta_i, theta_o = polar
    every = np.stack([theta_i, u[:, 1] * 2 * np.pi, theta_o, u[:, 3] * 2 * np.pi])
    for k, way in enumerate(ways):
        every[:, k :: len(ways)] = way.unfolded(every[:, k :: len(ways)])
    return readable(every, instrument, isotropic)[:, :count]


def readable(angles: Angles, instrument: Instrument, isotropic: bool = False) -> Angles:
    """Those of the directions that the axes reach, whose apertures are above the horizon and not in the shadow."""
    theta_i, phi_i, theta_o, phi_o = angles
    if isotropic:
        turn = abs((phi_o - phi_i + np.pi) % (2 * np.pi) - np.pi)
        phi_i = np.full_like(phi_i, instrument.ranges[1][0])
        one, other = phi_i + turn, (phi_i - turn) % (2 * np.pi)
        low, high = instrument.ranges[3]
        phi_o = np.where((one >= low - 1e-9) & (one <= high + 1e-9), one, other)
    degrees = np.round(np.degrees(np.stack([theta_i, phi_i, theta_o, phi_o])), DECIMALS)
    degrees[1::2] %= 360.0
    angles = np.radians(degrees)
    wi, wo = from_spherical(angles[0], angles[1], np), from_spherical(angles[2], angles[3], np)
    between = np.arccos(np.clip(sum(a * b for a, b in zip(wi, wo, strict=True)), -1.0, 1.0))
    most_i, most_o = highest(instrument)
    folded_i, folded_o = (np.minimum(a, np.pi - a) for a in (angles[0], angles[2]))  # from the normal of their side
    below = (folded_i <= most_i + 1e-6) & (folded_o <= most_o + 1e-6)
    return angles[:, instrument.reaches(angles) & below & (between >= instrument.shadow)]


def highest(instrument: Instrument) -> tuple[float, float]:
    """Largest polar angles of light and detector whose whole aperture is above the horizon, at most 85°.

    From the normal of their side: what reaches behind the sample reaches as far there.
    """
    half_angles = instrument.source_half_angle, instrument.detector_half_angle
    ranges = instrument.ranges[0], instrument.ranges[2]
    i, o = (min(r[1], THETA_MAX, math.pi / 2 - h) for r, h in zip(ranges, half_angles, strict=True))
    return i, o
