"""Readings weighed by a scene: the error that a model makes of its radiance, and the cheapest model that it allows."""

import dataclasses

import numpy as np

from gonio.data.scene import Scene, ScenePairs
from gonio.fitting.problem.losses import transform
from gonio.fitting.problem.readings import Readings
from gonio.fitting.selection.candidate import Choice, Tried
from gonio.fitting.selection.candidate_model import Scenery, values
from gonio.fitting.selection.criteria import neighbourhood, noise_deviation
from gonio.fitting.selection.warm_start import fitted
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction

PAIRS = 4000
FAR = 5.0  # degrees between a scene's directions and the nearest readings, from which on it is said
# Nanoseconds of one evaluation in double precision on one thread, for a sense of what a renderer pays
# (tests/benchmarks/evaluate_models.py says what they are here and now).
COST = {"lambert": 8.0, "ggx": 8.0, "beckmann": 22.0, "eon": 80.0, "std": 1800.0}


def cost(t: Tried) -> float:
    """Nanoseconds of an evaluation, as far as they are known beforehand."""
    return sum(COST[part.model] for part in t.parts)


@dataclasses.dataclass(frozen=True)
class Seen:
    """A scene by the readings nearest to what it sees: their numbers, and where each of its pairs of directions is."""

    scene: Scene
    pairs: ScenePairs
    cells: np.ndarray  # (m,) readings that are used
    at: np.ndarray  # (N,) which of them stands for a pair
    distance: float  # degrees, the median between a pair and its reading

    @property
    def weight(self) -> np.ndarray:
        """Weight (m,) of the squared error of f of each reading, for a light of small extent."""
        amount2 = self.pairs.share[self.pairs.view] * self.pairs.amount**2
        return np.bincount(self.at, amount2, minlength=self.cells.size)

    def error(self, model_f: np.ndarray, f: np.ndarray, noise: np.ndarray | None = None) -> float:
        """Relative rms error of the radiance, from f at the cells (m, C); known noise of the readings is taken off."""
        pairs = self.pairs
        size = pairs.rms(f[self.at])
        off = pairs.rms((model_f - f)[self.at]) ** 2
        if noise is not None:
            off -= self._noise2(noise)
        return float(np.sqrt(max(off, 0.0))) / size if size > 0 else float("nan")

    def part_of_noise(self, f: np.ndarray, noise: np.ndarray) -> float:
        """The share of the radiance's rms that the noise of the readings makes by itself."""
        size = self.pairs.rms(f[self.at])
        return float(np.sqrt(self._noise2(noise))) / size if size > 0 else float("nan")

    def _noise2(self, noise: np.ndarray) -> float:
        # A reading that stands for several pairs of one radiance errs alike in all of them.
        key = self.pairs.view.astype(np.int64) * self.cells.size + self.at
        unique, back = np.unique(key, return_inverse=True)
        amount = np.bincount(back, self.pairs.amount)
        share, at = self.pairs.share[unique // self.cells.size], unique % self.cells.size
        return float(np.mean(np.sum((share * amount**2)[:, None] * noise[at] ** 2, axis=0)))


def seen(scene: Scene, readings: Readings, turned: bool) -> Seen:
    """The readings nearest to the directions that a scene sees. `turned`: whether the surface's own azimuth matters."""
    from scipy.spatial import cKDTree

    pairs = scene.pairs(PAIRS)
    usable = np.flatnonzero(readings.valid.all(axis=1))
    if not usable.size:
        raise GonioError("no cell has a valid reading in every channel, which a scene needs; choose one with --channel")
    part = readings.part(usable)
    near, at = cKDTree(_place(part.wi, part.wo, turned)).query(_place(pairs.wi, pairs.wo, turned))
    cells, at = np.unique(at, return_inverse=True)
    return Seen(scene, pairs, usable[cells], at.ravel(), float(np.degrees(np.median(near))))


def _place(wi: Direction, wo: Direction, turned: bool) -> np.ndarray:
    """Coordinates of pairs (n, 6) where near means alike; azimuth and side of the plane count only if `turned`."""
    wi, wo = (np.stack([np.asarray(c, float) for c in w]) for w in (wi, wo))
    if turned:
        return np.concatenate([wi, wo]).T
    sin_i, sin_o = np.hypot(wi[0], wi[1]), np.hypot(wo[0], wo[1])
    off = sin_i > 1e-9
    along = np.where(off, wi[:2] / np.where(off, sin_i, 1.0), wo[:2] / np.where(sin_o > 0, sin_o, 1.0))
    x, y = np.sum(along * wo[:2], axis=0), along[0] * wo[1] - along[1] * wo[0]
    return np.stack([sin_i, np.zeros_like(sin_i), wi[2], x, np.abs(y), wo[2]], axis=1)


def judged(look: Seen, model_f: np.ndarray, readings: Readings) -> tuple[float, float]:
    """(error, share of noise) of a model's f at a scene's readings (m, C), the noise being seen between neighbours."""
    near = neighbourhood(readings.wi, readings.wo)
    noise = noise_deviation(model_f - readings.f, np.abs(model_f), readings.valid, near)
    return look.error(model_f, readings.f, noise), look.part_of_noise(readings.f, noise)


@dataclasses.dataclass(frozen=True)
class Allowed:
    """A tried model with its numbers for a scene, and the error that it makes there."""

    tried: Tried
    error: float
    cost: float


def allowed(choice: Choice, look: Seen) -> list[Allowed]:
    """All that was tried, fitted once more for the scene, cheapest first (evaluation, then free numbers).

    Where the residuals of the best fit exceed the noise the excess is error, not noise.
    """
    s = choice.scenery
    used = s.weight > 0
    slope = transform(s.loss, s.f * s.cosine, s.floor, np)[1] * s.cosine
    noise = np.where(used, 1.0 / np.where(used, s.weight * slope, 1.0), 0.0)
    weight = used * np.sqrt(look.weight / np.mean(look.weight))[:, None]
    mine = Scenery(s.wi, s.wo, s.f, s.f, weight, np.ones_like(s.cosine), "linear", 1.0)
    found = []
    for t in choice.tried:
        p, _ = fitted(t.parts, t.p, mine)
        f = values(t.parts, p, mine)[0]
        error = look.error(f, s.f, noise)
        found.append(Allowed(dataclasses.replace(t, p=p), error, cost(t)))
    return sorted(found, key=lambda a: (a.cost, a.tried.size, a.error))


def cheapest(choice: Choice, options: list[Allowed], tolerance: float) -> Allowed | None:
    """The cheapest that meets the tolerance and is no larger than what the data ask for; None where none does."""
    return next((a for a in options if a.error <= tolerance and a.tried.size <= choice.chosen.size), None)
