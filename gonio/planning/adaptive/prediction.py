"""What the readings so far predict, with the error that is expected of it."""

import abc
from typing import Any, NamedTuple

import numpy as np

from gonio.instrument.instrument import Instrument
from gonio.planning.adaptive.accuracy import random_directions
from gonio.planning.adaptive.session import Session
from gonio.planning.shots import Shots
from gonio.planning.ways import Way

JUDGED = 800
"""Directions over which the error is expected."""
POOL = 4000
DEFENSIVE = 0.5
"""Share of the check shots that go where no error is expected as well."""


class CheckShots(NamedTuple):
    """Directions (4, n), and how many times too often each was drawn (n,)."""

    angles: np.ndarray
    often: np.ndarray


class Prediction(abc.ABC):
    """A prediction of all directions from the readings of a session."""

    instrument: Instrument
    isotropic: bool

    @property
    @abc.abstractmethod
    def ways(self) -> tuple[Way, ...]:
        """From one side of the sample to another, on which it predicts."""

    @abc.abstractmethod
    def values(self, angles: np.ndarray) -> np.ndarray:
        """f (n, C), 1/sr, at directions (4, n)."""

    @abc.abstractmethod
    def squares(self, angles: np.ndarray) -> np.ndarray:
        """Expected squares (n,) of the relative error."""

    @abc.abstractmethod
    def next_shots(self, session: Session, most: int, seconds: float, rng: np.random.Generator) -> Shots:
        """The shots of the next round, so many or fewer, and of so many seconds or fewer."""

    @abc.abstractmethod
    def facts(self) -> dict[str, Any]:
        """For the provenance: what predicts."""

    def expected(self, rng: np.random.Generator) -> float:
        """The rms error that is expected on the way where it is largest."""
        angles = random_directions(JUDGED, self.instrument, self.isotropic, rng, self.ways)
        squares = self.squares(angles)
        return float(np.sqrt(max(squares[here].mean() for way in self.ways if (here := way.reads(angles)).any())))

    def check_shots(self, count: int, rng: np.random.Generator) -> CheckShots:
        """Directions that show the error: half of them evenly, half the more often the larger it is expected to be.

        About as many of each way.
        """
        every = [self._of_way(way, max(1, count // len(self.ways)), rng) for way in self.ways]
        return CheckShots(*(np.concatenate(c, axis=-1) for c in zip(*every, strict=True)))

    def _of_way(self, way: Way, count: int, rng: np.random.Generator) -> CheckShots:
        pool = random_directions(POOL, self.instrument, self.isotropic, rng, (way,))
        squares = self.squares(pool)
        often = DEFENSIVE + (1 - DEFENSIVE) * squares / max(squares.mean(), 1e-300)
        often /= often.mean()
        chosen = np.searchsorted(np.cumsum(often) / often.size, (rng.random() + np.arange(count)) / count)
        chosen = np.minimum(chosen, often.size - 1)
        return CheckShots(pool[:, chosen], often[chosen])
