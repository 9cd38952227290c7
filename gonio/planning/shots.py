"""Shots: directions with counting times; what they tell of a model's numbers, and their best order."""

import dataclasses
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gonio.data.files import new_file
from gonio.data.formats.csv.columns import write_columns
from gonio.data.stated import TERMS
from gonio.instrument.aperture import irradiance
from gonio.instrument.instrument import Instrument, Systematic
from gonio.instrument.noise import standard_uncertainty
from gonio.instrument.pace import AXES, Pace
from gonio.planning.prior import Prior

STEP = 1e-4
"""Radians, of differences by systematic errors."""
TIMES = 48
"""Counting times that are compared."""
LEAST_SECONDS = 0.05
SOLVER_SECONDS = 1.0
COUNTS = 60_000
"""Units of the longest way in the solver's whole numbers."""


class Shots(NamedTuple):
    """Readings one after another: (theta_i, phi_i, theta_o, phi_o), radians, shape (4, n); counting seconds (n,)."""

    angles: np.ndarray
    seconds: np.ndarray


def counting(instrument: Instrument) -> Instrument:
    """The instrument; an ideal one counts at its own rate, for without noise every plan would do."""
    if instrument.has_noise:
        return instrument
    return dataclasses.replace(instrument, photons=instrument.pace.count_rate * instrument.seconds)


@dataclasses.dataclass(frozen=True)
class Sites:
    """Some directions (4, n), with the model's values (S, n, C) and slopes (S, n, C, P) there for S draws of a prior.

    `shifts` (S, n, C, Q): change of f by one standard uncertainty of each systematic error: alignment and calibration.
    """

    instrument: Instrument
    angles: np.ndarray
    f: np.ndarray
    slopes: np.ndarray
    shifts: np.ndarray

    @classmethod
    def of(cls, prior: Prior, instrument: Instrument, angles: np.ndarray, draws: np.ndarray) -> "Sites":
        """The model at some directions, for draws (S, P)."""
        each = [prior.at_angles(p, angles) for p in draws]
        f, slopes = np.stack([f for f, _ in each]), np.stack([j for _, j in each])
        shifts = []
        for name, stated in instrument.uncertainties.items():
            if TERMS[name].acts == "factor":
                shifts.append(f * stated.standard)
            if TERMS[name].acts == "angle":
                high, low = (Systematic(**{name: sign * STEP}).true_directions(angles) for sign in (1, -1))
                difference = [prior.values_and_slopes(p, *high)[0] - prior.values_and_slopes(p, *low)[0] for p in draws]
                shifts.append(np.stack(difference) / (2 * STEP) * stated.standard)
        return cls(instrument, angles, f, slopes, np.stack(shifts, axis=-1) if shifts else np.zeros((*f.shape, 0)))

    def part(self, which: np.ndarray) -> "Sites":
        """Some of the directions."""
        f, slopes, shifts = (a[:, which] for a in (self.f, self.slopes, self.shifts))
        return dataclasses.replace(self, angles=self.angles[:, which], f=f, slopes=slopes, shifts=shifts)

    def variance(self, seconds: np.ndarray) -> np.ndarray:
        """Variances (S, n, C) of readings that are counted so long (n,), as measurements store them."""
        lit = irradiance(np.abs(np.cos(self.angles[0])), self.instrument.source_half_angle)
        exposure = seconds / self.instrument.seconds
        return np.stack([standard_uncertainty(self.instrument, f, lit, 1.0, exposure) ** 2 for f in self.f])

    def best_seconds(self, overhead: float, longest: float) -> np.ndarray:
        """The counting times (n,) that tell most for their time, `overhead` included."""
        times = np.geomspace(LEAST_SECONDS, max(longest, 2 * LEAST_SECONDS), TIMES)
        gains = [
            np.sum(self.f[:1] ** 2 / self._positive_variance(np.full(self.angles.shape[1], t))[:1], axis=(0, 2))
            / (t + overhead)
            for t in times
        ]
        return times[np.argmax(gains, axis=0)]

    def rows(self, seconds: np.ndarray) -> np.ndarray:
        """Slopes and shifts over standard uncertainties (S, n, C, P + Q), as `gonio.planning.design` takes them."""
        both = np.concatenate([self.slopes, self.shifts], axis=-1)
        return both / np.sqrt(self._positive_variance(seconds))[..., None]

    def _positive_variance(self, seconds: np.ndarray) -> np.ndarray:
        """Where the model is dark nothing is counted, and nothing is learnt."""
        return np.maximum(self.variance(seconds), 1e-300)


def write_shots(path: str | os.PathLike[str], shots: Shots, what: str, hours: float, force: bool = False) -> Path:
    """Writes shots as CSV, which `gonio measure --scan` takes. GonioError where it exists or cannot be."""
    columns = {n: np.degrees(a).round(3) for n, a in zip(AXES, shots.angles, strict=True)}
    with new_file(path, force) as part, part.open("w", encoding="utf-8") as file:
        comments = [f"{what}: angles in degrees, counting times in seconds, {hours:.4g} h"]
        write_columns(file, columns | {"seconds": shots.seconds}, comments)
    return Path(path)


def ordered(shots: Shots, pace: Pace, patience: float = SOLVER_SECONDS) -> Shots:
    """The same shots in the order of least travel, by a solver of the travelling salesman's problem.

    It takes `patience` seconds at most. The path may begin and end anywhere, and is never longer than in the order
    given.
    """
    import fast_tsp

    places, place = np.unique(shots.angles, axis=1, return_inverse=True)
    if places.shape[1] < 3:
        return _reordered(shots, np.argsort(place.ravel(), kind="stable"))
    ways = pace.moving(places[:, :, None], places[:, None, :])
    lengths = np.zeros((places.shape[1] + 1,) * 2, np.uint32)  # the last is a place that is near to all: the open end
    lengths[:-1, :-1] = np.rint(ways * (COUNTS / max(ways.max(), 1e-9))).astype(np.uint32)
    tour = fast_tsp.find_tour(lengths, patience, max_threads=1, stop_when_converged=True)
    end = tour.index(places.shape[1])
    rank = np.argsort(tour[end + 1 :] + tour[:end])
    best = _reordered(shots, np.argsort(rank[place.ravel()], kind="stable"))
    both = [best, _reordered(shots, np.arange(shots.seconds.size))]
    return min(both, key=lambda s: pace.path_seconds(s.angles, s.seconds))


def _reordered(shots: Shots, order: np.ndarray) -> Shots:
    return Shots(shots.angles[:, order], shots.seconds[order])
