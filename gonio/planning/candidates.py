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


def both_turning(angles: Angles, instrument: Instrument) -> Angles:
    """The same directions (4, n) of an isotropic surface, the azimuth between them shared by the axes as they are fast.

    Both turn at once, which halves the way of axes that are equally fast. Where their ranges do not allow that, as they
    came.
    """
    speeds, (low, high) = (
        np.broadcast_to(np.asarray(instrument.pace.axis_speed), angles.shape[:1]),
        instrument.ranges[1],
    )
    share = min(speeds[1] / (speeds[1] + speeds[3]), (high - low) / np.pi)
    turn = np.degrees(abs((angles[3] - angles[1] + np.pi) % (2 * np.pi) - np.pi))
    phi_i = np.round(math.degrees(low) + share * (180.0 - turn), DECIMALS)
    turned = np.stack([angles[0], np.radians(phi_i % 360.0), angles[2], np.radians((phi_i + turn) % 360.0)])
    return np.where(instrument.reaches(turned), turned, angles)


def highest(instrument: Instrument) -> tuple[float, float]:
    """Largest polar angles of light and detector whose whole aperture is above the horizon, at most 85°.

    From the normal of their side: what reaches behind the sample reaches as far there.
    """
    half_angles = instrument.source_half_angle, instrument.detector_half_angle
    ranges = instrument.ranges[0], instrument.ranges[2]
    i, o = (min(r[1], THETA_MAX, math.pi / 2 - h) for r, h in zip(ranges, half_angles, strict=True))
    return i, o
