"""Without a model: directions where the kriged readings promise the largest fall of the error."""

import dataclasses
from typing import Any

import numpy as np

from gonio.data.interpolation.kriging import Symmetry
from gonio.instrument.instrument import Instrument
from gonio.models.errors import GonioError
from gonio.planning.adaptive.accuracy import random_directions
from gonio.planning.adaptive.prediction import JUDGED, Prediction
from gonio.planning.adaptive.session import Session
from gonio.planning.adaptive.way_kriging import Offers, WayKriging
from gonio.planning.candidates import highest, readable
from gonio.planning.shots import Shots
from gonio.planning.ways import Way

OFFERED, AT_EDGE = 600, 200
"""Directions that are offered anywhere and at the ends of the angles, of each way of the light."""
BATCH, GROWTH = 12, 0.25
"""Readings of a round: so many for each way, or that share of those there are."""
SEARCHED, WRONG = 1.5, 2.0
"""Times as many readings, and times the error expected, from which on the law is searched from anew."""
FEWEST = 8
"""Valid readings that anything is predicted from, on each way."""


@dataclasses.dataclass(frozen=True)
class TablePrediction(Prediction):
    """Kriged readings of each way of the light by themselves: nothing is interpolated across the horizon.

    `searched`: whether the laws were searched from anew.
    """

    krigings: tuple[WayKriging, ...]
    instrument: Instrument
    isotropic: bool
    searched: bool

    @classmethod
    def of(cls, session: Session, ratio: float) -> "TablePrediction":
        """The kriging of the readings so far by their likeliest laws, searched from the last ones or from anew.

        `ratio`: the error that the last check showed, over what was expected.
        """
        last = [r for r in session.rounds if "law" in r]
        searched = [r for r in last if r["searched"]]
        again = not searched or session.count > SEARCHED * searched[-1]["readings"][0] or ratio > WRONG
        krigings = []
        for number, way in enumerate(session.ways):
            on_way = way.reads(session.angles)
            usable = session.valid & on_way
            if usable.sum() < FEWEST:
                of = f" of {way.words()}" if len(session.ways) > 1 else ""
                raise GonioError(
                    f"of {on_way.sum()} readings{of} {usable.sum()} are valid, too few to go by: the detector is full, "
                    "or a table that was read holds nothing there; give fewer photons, or smaller ranges of the axes"
                )
            readings = session.angles[:, usable], session.values["f"][usable], session.values["u_f"][usable]
            symmetry = Symmetry(session.isotropic, way.reciprocal, 1.0 if way.bend == 1.0 else 1 / way.bend)
            start = None if again else np.array(last[-1]["law"][number])
            krigings.append(WayKriging.of(way, session.instrument, readings, symmetry, start))
        return cls(tuple(krigings), session.instrument, session.isotropic, again)

    @property
    def ways(self) -> tuple[Way, ...]:
        """Of the light, each with a kriging of its own."""
        return tuple(k.way for k in self.krigings)

    def facts(self) -> dict[str, Any]:
        return {"law": [k.system.law.tolist() for k in self.krigings], "searched": self.searched}

    def values(self, angles: np.ndarray) -> np.ndarray:
        f = np.zeros((angles.shape[1], self.krigings[0].system.samples.values.shape[1]))
        for kriging in self.krigings:
            here = kriging.way.reads(angles)
            f[here] = kriging.values(angles[:, here])
        return f

    def squares(self, angles: np.ndarray) -> np.ndarray:
        squares = np.zeros(angles.shape[1])
        for kriging in self.krigings:
            here = kriging.way.reads(angles)
            squares[here] = kriging.squares(angles[:, here])
        return squares

    def next_shots(self, session: Session, most: int, seconds: float, rng: np.random.Generator) -> Shots:
        """Where one reading after another lets the mean expected square fall most."""
        batch = max(BATCH * len(self.krigings), int(GROWTH * session.count))
        angles = self._worst(min(batch, most), rng)
        count, limit = angles.shape[1], session.seconds() + seconds
        while count > 1 and session.seconds(session.shots(angles[:, :count])) > limit:
            count = int(0.9 * count)
        return session.shots(angles[:, :count])

    def _worst(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Directions (4, count)."""
        offers = []
        for kriging in self.krigings:
            there = self.instrument, self.isotropic, rng, (kriging.way,)
            judged = random_directions(JUDGED // len(self.krigings), *there)
            offered = [random_directions(OFFERED, *there), at_edges(AT_EDGE, *there)]
            offers.append(Offers(kriging, judged, np.concatenate(offered, axis=1)))
        chosen = []
        for _ in range(min(count, sum(o.angles.shape[1] for o in offers))):
            most = max(offers, key=lambda o: float(o.falls.max()))
            best = int(np.argmax(most.falls))
            chosen.append(most.angles[:, best])
            most.take(best)
        return np.stack(chosen, axis=1)


def at_edges(
    count: int, instrument: Instrument, isotropic: bool, rng: np.random.Generator, ways: tuple[Way, ...] = (Way(),)
) -> np.ndarray:
    """About `count` directions (4, n) of one way of which one is as low as it can be read."""
    (way,) = ways
    angles = way.unfolded(random_directions(count, instrument, isotropic, rng, ways))
    lowest = rng.random(angles.shape[1]) < 0.5
    for axis, which, most in zip((0, 2), (lowest, ~lowest), highest(instrument), strict=True):
        angles[axis, which] = most
    return readable(way.unfolded(angles), instrument, isotropic)
