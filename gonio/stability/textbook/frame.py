"""Angles of directions as textbooks name them, in mpmath numbers, and the guard that every formula shares.

A direction is a tuple (x, y, z) that need not be a unit vector to the last digit: cosines μ are its z component, angles
are those of its direction, so that an error of length does not pass for an angle. The half vector is normalised.
"""

import functools

from mpmath import mp, mpf

GUARD = 20  # digits carried beyond the caller's: 1 - cos of small angles loses up to that many


def above_horizon(formula):
    """The formula where both directions are above the horizon, with guard digits; 0 elsewhere."""

    @functools.wraps(formula)
    def evaluate(params, options, wi, wo, **more):
        if wi[2] <= 0 or wo[2] <= 0:
            return mpf(0)
        with mp.workdps(mp.dps + GUARD):
            value = formula(params, options, wi, wo, **more)
        return +value

    return evaluate


def unit(v):
    length = mp.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    return v[0] / length, v[1] / length, v[2] / length


def half_vector(wi, wo):
    return unit((wi[0] + wo[0], wi[1] + wo[1], wi[2] + wo[2]))


def theta(v):
    """Polar angle from +z."""
    return mp.atan2(mp.hypot(v[0], v[1]), v[2])


def phi(v):
    """Azimuth; 0 for the normal itself."""
    return mp.atan2(v[1], v[0])


def delta_phi(wi, wo):
    return phi(wo) - phi(wi)


def angle(a, b):
    """Angle between two directions."""
    a, b = unit(a), unit(b)
    difference = mp.sqrt(sum((p - q) ** 2 for p, q in zip(a, b, strict=True)))
    total = mp.sqrt(sum((p + q) ** 2 for p, q in zip(a, b, strict=True)))
    return 2 * mp.atan2(difference, total)


def theta_d(wi, wo):
    """Angle between either direction and the half vector."""
    return angle(wi, wo) / 2


def mirror(v):
    """The direction mirrored in the normal."""
    return -v[0], -v[1], v[2]


def projected_distance2(wi, wo):
    """|β − β0|²: squared distance, in the projected disc, of wo from the mirror direction of wi."""
    return (wi[0] + wo[0]) ** 2 + (wi[1] + wo[1]) ** 2
