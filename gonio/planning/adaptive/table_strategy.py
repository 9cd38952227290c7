"""Without a model: directions where the kriged readings promise the largest fall of the error."""

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import KDTree

from gonio.data.interpolation.kriging import Kriging, Samples, correlation, likeliest, places
from gonio.data.interpolation.scattered import compressed
from gonio.instrument.aperture import irradiance
from gonio.instrument.instrument import Instrument
from gonio.instrument.noise import standard_uncertainty
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.planning.adaptive.accuracy import FLOOR, random_directions

JUDGED, OFFERED, AT_EDGE = 800, 600, 200
"""Directions over which the error is expected, and that are offered anywhere and at the ends of the angles."""
POOL = 4000
DEFENSIVE = 0.5
"""Share of the check shots that go where no error is expected as well."""
NEIGHBOURS, PRIOR = 6, 2.0
"""Readings whose prediction by the others tells how good predictions near them are; and those that stand for all."""
LARGEST = 1.0
"""Of the squares of relative errors."""


class Drawn(NamedTuple):
    """Directions (4, n), and how many times too often each was drawn (n,)."""

    angles: np.ndarray
    often: np.ndarray


@dataclasses.dataclass(frozen=True)
class Prediction:
    """What the readings so far predict, and with what variance; compressed values are relative errors' own scale."""

    system: Kriging
    instrument: Instrument

    @classmethod
    def of(cls, samples: Samples, instrument: Instrument, law: np.ndarray | None) -> "Prediction":
        """The kriging of the readings by their likeliest law, which is searched from a law, or from anew."""
        return cls(Kriging.of(samples, likeliest(samples, law)), instrument)

    def values(self, angles: np.ndarray) -> np.ndarray:
        """f (n, C), 1/sr, at directions (4, n)."""
        values = self.system.samples.values
        inside = np.clip(self.system.predicted(*_pairs(angles)), values.min(axis=0) - 0.5, values.max(axis=0) + 0.5)
        return 2 * FLOOR * np.sinh(inside)

    def squares(self, angles: np.ndarray) -> np.ndarray:
        """Expected squares (n,) of the relative error."""
        solved = solve_triangular(
            self.system.lower, self.system.covariances(*_pairs(angles)).T, lower=True, check_finite=False
        )
        return np.clip(self._whole() - np.sum(solved**2, axis=0), 0.0, LARGEST) * self._surprise(angles)

    def expected(self, isotropic: bool, rng: np.random.Generator) -> float:
        """The rms error that is expected."""
        return float(np.sqrt(self.squares(random_directions(JUDGED, self.instrument, isotropic, rng)).mean()))

    def check_shots(self, count: int, isotropic: bool, rng: np.random.Generator) -> Drawn:
        """Directions that show the error: half of them evenly, half the more often the larger it is expected to be."""
        pool = random_directions(POOL, self.instrument, isotropic, rng)
        squares = self.squares(pool)
        often = DEFENSIVE + (1 - DEFENSIVE) * squares / max(squares.mean(), 1e-300)
        often /= often.mean()
        ends = np.cumsum(often) / often.size
        chosen = np.searchsorted(ends, (rng.random() + np.arange(count)) / count)
        chosen = np.minimum(chosen, often.size - 1)
        return Drawn(pool[:, chosen], often[chosen])

    def next_shots(self, count: int, isotropic: bool, rng: np.random.Generator) -> np.ndarray:
        """Directions (4, n), one after another that whose reading lets the mean expected square fall most."""
        judged = random_directions(JUDGED, self.instrument, isotropic, rng)
        offered = np.concatenate(
            [
                random_directions(OFFERED, self.instrument, isotropic, rng),
                at_edges(AT_EDGE, self.instrument, isotropic, rng),
            ],
            axis=1,
        )
        both = [_pairs(a) for a in (judged, offered)]
        law, lower = self.system.law, self.system.lower
        variance, remainder = np.exp(law[8]), np.exp(law[6])
        near = [solve_triangular(lower, self.system.covariances(*p).T, lower=True, check_finite=False) for p in both]
        here = [places(*p, law, isotropic, np) for p in both]
        across = variance * correlation(here[0], here[1], remainder, np) - near[0].T @ near[1]
        among = variance * correlation(here[1], here[1], remainder, np) - near[1].T @ near[1]
        across *= np.sqrt(self._surprise(judged))[:, None]
        noise = self._noise(offered) + np.exp(law[7] + law[8])
        chosen = []
        for _ in range(min(count, offered.shape[1])):
            each = np.sum(across**2, axis=0) / (np.maximum(np.diagonal(among), 0.0) + noise)
            best = int(np.argmax(each))
            chosen.append(best)
            row = among[best] / (max(among[best, best], 0.0) + noise[best])
            across -= np.outer(across[:, best], row)
            among -= np.outer(among[:, best].copy(), row)
        return offered[:, chosen]

    def _whole(self) -> float:
        return float(np.exp(self.system.law[8]) * (1 + np.exp(self.system.law[6])))

    def _surprise(self, angles: np.ndarray) -> np.ndarray:
        """Squares (n,) of the errors of the nearest readings left out, over what they are expected to be."""
        here, samples = self.system.here, self.system.samples
        there = places(*_pairs(angles), self.system.law, samples.isotropic, np)
        tree, count = KDTree(np.concatenate(here, axis=1)), min(NEIGHBOURS, len(samples.noise))
        near = tree.query(np.concatenate(there, axis=1), count)[1].reshape(-1, count)
        return (self._left_out[near].sum(axis=1) + PRIOR * self._left_out.mean()) / (count + PRIOR)

    @functools.cached_property
    def _left_out(self) -> np.ndarray:
        errors, variances = self.system.left_out()
        return np.mean(errors**2 / variances[:, None], axis=1)

    def _noise(self, angles: np.ndarray) -> np.ndarray:
        """Variances (n,) of compressed readings there."""
        f = self.values(angles)
        u_f = standard_uncertainty(self.instrument, f, irradiance(np.cos(angles[0]), self.instrument.source_half_angle))
        return np.mean((u_f / np.hypot(f, 2 * FLOOR)) ** 2, axis=1)


def at_edges(count: int, instrument: Instrument, isotropic: bool, rng: np.random.Generator) -> np.ndarray:
    """Directions of which one is as low as it can be read."""
    angles = random_directions(count, instrument, isotropic, rng)
    which = np.where(rng.random(angles.shape[1]) < 0.5, 0, 2)
    angles[which, np.arange(which.size)] = np.max(angles[[0, 2]], initial=0.0)
    return angles


def samples_at(angles: np.ndarray, f: np.ndarray, u_f: np.ndarray, isotropic: bool) -> Samples:
    """Readings (n, C) in directions (4, n) as kriging takes them."""
    noise = np.mean((u_f / np.hypot(f, 2 * FLOOR)) ** 2, axis=1)
    return Samples(*_pairs(angles), compressed(f, FLOOR), noise, isotropic)


def _pairs(angles: np.ndarray) -> tuple[Direction, Direction]:
    theta_i, phi_i, theta_o, phi_o = angles
    return from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
