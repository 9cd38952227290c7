"""Kriged readings of one way of the light, from one side of the sample to another."""

import dataclasses
import functools

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import KDTree

from gonio.data.interpolation.kriging import Kriging, Samples, Symmetry, correlation, likeliest, places
from gonio.data.interpolation.scattered import compressed
from gonio.instrument.aperture import irradiance
from gonio.instrument.instrument import Instrument
from gonio.instrument.noise import standard_uncertainty
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.planning.adaptive.accuracy import FLOOR
from gonio.planning.ways import Way

NEIGHBOURS, PRIOR = 6, 2.0
"""Readings whose prediction by the others tells how good predictions near them are; and those that stand for all."""
LARGEST = 1.0
"""Of the squares of relative errors."""


@dataclasses.dataclass(frozen=True)
class WayKriging:
    """The kriging of the readings on one way; compressed values are on the scale of relative errors."""

    way: Way
    system: Kriging
    instrument: Instrument

    @classmethod
    def of(
        cls,
        way: Way,
        instrument: Instrument,
        readings: tuple[np.ndarray, np.ndarray, np.ndarray],
        symmetry: Symmetry,
        start: np.ndarray | None,
    ) -> "WayKriging":
        """That of readings (angles (4, n), f and u_f (n, C)), its law searched from `start`, or from anew."""
        angles, f, u_f = readings
        noise = np.mean((u_f / np.hypot(f, 2 * FLOOR)) ** 2, axis=1)
        samples = Samples(*pairs_of(way, angles), compressed(f, FLOOR), noise, symmetry)
        return cls(way, Kriging.of(samples, likeliest(samples, start)), instrument)

    def values(self, angles: np.ndarray) -> np.ndarray:
        """f (n, C), 1/sr, at directions (4, n) on this way."""
        values = self.system.samples.values
        predicted = self.system.predicted(*pairs_of(self.way, angles))
        return 2 * FLOOR * np.sinh(np.clip(predicted, values.min(axis=0) - 0.5, values.max(axis=0) + 0.5))

    def squares(self, angles: np.ndarray) -> np.ndarray:
        """Expected squares (n,) of the relative error there."""
        near = self.system.covariances(*pairs_of(self.way, angles)).T
        solved = solve_triangular(self.system.lower, near, lower=True, check_finite=False)
        whole = np.exp(self.system.law[8]) * (1 + np.exp(self.system.law[6]))
        return np.clip(whole - np.sum(solved**2, axis=0), 0.0, LARGEST) * self.left_out_ratio(angles)

    def left_out_ratio(self, angles: np.ndarray) -> np.ndarray:
        """Squares (n,) of the errors of the nearest readings left out, over what they are expected to be."""
        here, samples = self.system.here, self.system.samples
        there = places(*pairs_of(self.way, angles), self.system.law, samples.symmetry, np)
        tree, count = KDTree(np.concatenate(here, axis=1)), min(NEIGHBOURS, len(samples.noise))
        near = tree.query(np.concatenate(there, axis=1), count)[1].reshape(-1, count)
        return (self._left_out[near].sum(axis=1) + PRIOR * self._left_out.mean()) / (count + PRIOR)

    @functools.cached_property
    def _left_out(self) -> np.ndarray:
        errors, variances = self.system.left_out()
        return np.mean(errors**2 / variances[:, None], axis=1)

    def noise(self, angles: np.ndarray) -> np.ndarray:
        """Variances (n,) of compressed readings there."""
        f = self.values(angles)
        incident = irradiance(np.abs(np.cos(angles[0])), self.instrument.source_half_angle)
        u_f = standard_uncertainty(self.instrument, f, incident)
        return np.mean((u_f / np.hypot(f, 2 * FLOOR)) ** 2, axis=1)


class Offers:
    """Directions that may be read on one way, and how much each lets the expected squares of judged ones fall."""

    def __init__(self, kriging: WayKriging, judged: np.ndarray, offered: np.ndarray) -> None:
        """`judged` and `offered`: directions (4, n) and (4, m)."""
        both = [pairs_of(kriging.way, a) for a in (judged, offered)]
        law, system, symmetry = kriging.system.law, kriging.system, kriging.system.samples.symmetry
        variance, remainder = np.exp(law[8]), np.exp(law[6])
        near = [solve_triangular(system.lower, system.covariances(*p).T, lower=True, check_finite=False) for p in both]
        here = [places(*p, law, symmetry, np) for p in both]
        self._across = variance * correlation(here[0], here[1], remainder, np) - near[0].T @ near[1]
        self._among = variance * correlation(here[1], here[1], remainder, np) - near[1].T @ near[1]
        self._across *= np.sqrt(kriging.left_out_ratio(judged))[:, None]
        self._noise = kriging.noise(offered) + np.exp(law[7] + law[8])
        self.angles = offered
        self.falls = self._falls()

    def _falls(self) -> np.ndarray:
        return np.sum(self._across**2, axis=0) / (np.maximum(np.diagonal(self._among), 0.0) + self._noise)

    def take(self, best: int) -> None:
        """What is left to fall once one of them is read."""
        row = self._among[best] / (max(self._among[best, best], 0.0) + self._noise[best])
        self._across -= np.outer(self._across[:, best], row)
        self._among -= np.outer(self._among[:, best].copy(), row)
        self.falls = self._falls()


def pairs_of(way: Way, angles: np.ndarray) -> tuple[Direction, Direction]:
    """Directions (4, n) on a way as pairs, mirrored into the front."""
    theta_i, phi_i, theta_o, phi_o = way.unfolded(angles)
    return from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
