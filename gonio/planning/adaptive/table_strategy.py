"""Without a model: directions where the kriged readings promise the largest fall of the error."""

import dataclasses
import functools
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import KDTree

from gonio.data.interpolation.kriging import Kriging, Samples, correlation, likeliest, places
from gonio.data.interpolation.scattered import compressed
from gonio.instrument.aperture import irradiance
from gonio.instrument.instrument import Instrument
from gonio.instrument.noise import standard_uncertainty
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.planning.adaptive.accuracy import FLOOR, random_directions
from gonio.planning.adaptive.prediction import JUDGED, Prediction
from gonio.planning.adaptive.session import Session
from gonio.planning.candidates import highest, readable
from gonio.planning.shots import Shots

OFFERED, AT_EDGE = 600, 200
"""Directions that are offered anywhere and at the ends of the angles."""
BATCH, GROWTH = 12, 0.25
"""Readings of a round: so many, or that share of those there are."""
SEARCHED, WRONG = 1.5, 2.0
"""Times as many readings, and times the error expected, from which on the law is searched from anew."""
FEWEST = 8
"""Valid readings that anything is predicted from."""
NEIGHBOURS, PRIOR = 6, 2.0
"""Readings whose prediction by the others tells how good predictions near them are; and those that stand for all."""
LARGEST = 1.0
"""Of the squares of relative errors."""


@dataclasses.dataclass(frozen=True)
class TablePrediction(Prediction):
    """Kriged readings; compressed values are on the scale of relative errors.

    `searched`: whether the law was searched from anew.
    """

    system: Kriging
    instrument: Instrument
    searched: bool

    @classmethod
    def of(cls, session: Session, ratio: float) -> "TablePrediction":
        """The kriging of the readings so far by their likeliest law, searched from the last one or from anew.

        `ratio`: the error that the last check showed, over what was expected.
        """
        valid, last = session.valid, [r for r in session.rounds if "law" in r]
        if valid.sum() < FEWEST:
            raise GonioError(
                f"of {valid.size} readings {valid.sum()} are valid, too few to go by: the detector is full, or a table "
                "that was read holds nothing there; give fewer photons, or smaller ranges of the axes"
            )
        searched = [r for r in last if r["searched"]]
        again = not searched or session.count > SEARCHED * searched[-1]["readings"][0] or ratio > WRONG
        f, u_f = (session.values[name][valid] for name in ("f", "u_f"))
        samples = samples_at(session.angles[:, valid], f, u_f, session.isotropic)
        law = likeliest(samples, None if again else np.array(last[-1]["law"]))
        return cls(Kriging.of(samples, law), session.instrument, again)

    @property
    def isotropic(self) -> bool:
        """Of the samples."""
        return self.system.samples.isotropic

    def facts(self) -> dict[str, Any]:
        return {"law": self.system.law.tolist(), "searched": self.searched}

    def values(self, angles: np.ndarray) -> np.ndarray:
        """f (n, C), 1/sr, at directions (4, n)."""
        values = self.system.samples.values
        inside = np.clip(self.system.predicted(*_pairs(angles)), values.min(axis=0) - 0.5, values.max(axis=0) + 0.5)
        return 2 * FLOOR * np.sinh(inside)

    def squares(self, angles: np.ndarray) -> np.ndarray:
        """Expected squares (n,) of the relative error."""
        near = self.system.covariances(*_pairs(angles)).T
        solved = solve_triangular(self.system.lower, near, lower=True, check_finite=False)
        whole = np.exp(self.system.law[8]) * (1 + np.exp(self.system.law[6]))
        return np.clip(whole - np.sum(solved**2, axis=0), 0.0, LARGEST) * self._surprise(angles)

    def next_shots(self, session: Session, most: int, seconds: float, rng: np.random.Generator) -> Shots:
        """Where one reading after another lets the mean expected square fall most."""
        angles = self._worst(min(max(BATCH, int(GROWTH * session.count)), most), rng)
        count, limit = angles.shape[1], session.seconds() + seconds
        while count > 1 and session.seconds(session.shots(angles[:, :count])) > limit:
            count = int(0.9 * count)
        return session.shots(angles[:, :count])

    def _worst(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Directions (4, count)."""
        isotropic = self.isotropic
        judged = random_directions(JUDGED, self.instrument, isotropic, rng)
        offers = ((random_directions, OFFERED), (at_edges, AT_EDGE))
        offered = np.concatenate([of(n, self.instrument, isotropic, rng) for of, n in offers], axis=1)
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
    """About `count` directions (4, n) of which one is as low as it can be read."""
    angles = random_directions(count, instrument, isotropic, rng)
    lowest = rng.random(angles.shape[1]) < 0.5
    for axis, which, most in zip((0, 2), (lowest, ~lowest), highest(instrument), strict=True):
        angles[axis, which] = most
    return readable(angles, instrument, isotropic)


def samples_at(angles: np.ndarray, f: np.ndarray, u_f: np.ndarray, isotropic: bool) -> Samples:
    """Readings (n, C) in directions (4, n) as kriging takes them."""
    noise = np.mean((u_f / np.hypot(f, 2 * FLOOR)) ** 2, axis=1)
    return Samples(*_pairs(angles), compressed(f, FLOOR), noise, isotropic)


def _pairs(angles: np.ndarray) -> tuple[Direction, Direction]:
    theta_i, phi_i, theta_o, phi_o = angles
    return from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
