"""Pairs of directions with the angles that textbooks name, in mpmath numbers, and the guard of every formula.

A direction is a tuple (x, y, z) that need not be a unit vector to the last digit: cosines μ are its z component, angles
are those of its direction, so that an error of length does not pass for an angle. The half vector is normalised.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import mpmath
from mpmath import mpf

mp: Any = mpmath.mp
"""mpmath's context, whose functions no type checker knows: they are made at run time."""

GUARD = 20  # digits carried beyond the caller's: 1 - cos of small angles loses up to that many

Vector = tuple[mpf, mpf, mpf]
Params = Mapping[str, mpf]
Options = Mapping[str, str]


class TextbookForm:
    """A formula (params, options, pair) -> f, 1/sr, with guard digits; 0 where a direction is below the horizon."""

    def __init__(self, formula: Callable[..., mpf]):
        functools.update_wrapper(self, formula)
        self.formula = formula

    def __call__(self, params: Params, options: Options, wi: Vector, wo: Vector, **inside: Any) -> mpf:
        if wi[2] <= 0 or wo[2] <= 0:
            return mpf(0)
        with mp.workdps(mp.dps + GUARD):
            value = self.formula(params, options, Pair(wi, wo), **inside)
        return +value


def unit(v: Vector) -> Vector:
    length = mp.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    return v[0] / length, v[1] / length, v[2] / length


def theta(v: Vector) -> mpf:
    """Polar angle from +z."""
    return mp.atan2(mp.hypot(v[0], v[1]), v[2])


def phi(v: Vector) -> mpf:
    """Azimuth; 0 for the normal itself."""
    return mp.atan2(v[1], v[0])


def angle(a: Vector, b: Vector) -> mpf:
    """Angle between two directions."""
    a, b = unit(a), unit(b)
    difference = mp.sqrt(sum((p - q) ** 2 for p, q in zip(a, b, strict=True)))
    total = mp.sqrt(sum((p + q) ** 2 for p, q in zip(a, b, strict=True)))
    return 2 * mp.atan2(difference, total)


def mirror(v: Vector) -> Vector:
    """The direction mirrored in the normal."""
    return -v[0], -v[1], v[2]


class Pair:
    """Directions to the light and to the detector."""

    def __init__(self, wi: Vector, wo: Vector):
        self.wi, self.wo = wi, wo
        self.mu_i, self.mu_o = wi[2], wo[2]
        self.sum = wi[0] + wo[0], wi[1] + wo[1], wi[2] + wo[2]
        self.sum2 = self.sum[0] ** 2 + self.sum[1] ** 2 + self.sum[2] ** 2

    @functools.cached_property
    def half(self) -> Vector:
        return unit(self.sum)

    @functools.cached_property
    def theta_h(self) -> mpf:
        return theta(self.half)

    @functools.cached_property
    def cos_h(self) -> mpf:
        return mp.cos(self.theta_h)

    @functools.cached_property
    def cos_d(self) -> mpf:
        """Cosine of the angle between either direction and the half vector."""
        return mp.cos(self.phase / 2)

    @functools.cached_property
    def phase(self) -> mpf:
        """The phase angle, between the two directions."""
        return angle(self.wi, self.wo)

    @property
    def theta_i(self) -> mpf:
        return theta(self.wi)

    @property
    def theta_o(self) -> mpf:
        return theta(self.wo)

    @property
    def delta_phi(self) -> mpf:
        return phi(self.wo) - phi(self.wi)

    @property
    def projected_distance2(self) -> mpf:
        """|β − β0|²: squared distance, in the projected disc, of wo from the mirror direction of wi."""
        return self.sum[0] ** 2 + self.sum[1] ** 2
