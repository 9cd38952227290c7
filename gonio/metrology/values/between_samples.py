"""How far interpolation between scattered readings may be off, by how well each of them is predicted by the others."""

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.spatial import KDTree

from gonio.checks.table.energy import mirror_reach
from gonio.data.flags import Flag
from gonio.data.interpolation.inverse_distance import one_azimuth
from gonio.data.interpolation.kriging import Kriging
from gonio.data.interpolation.scattered import FlooredKriging, kriging_of
from gonio.data.table import Table
from gonio.metrology.values.uncertain_part import RECTANGULAR, Uncertain
from gonio.models.geometry.directions import Direction, rotate_z

ROWS = 1024
"""Pairs of directions at once."""
TELLING = 12
"""Nearest readings whose predictions tell how good the mean by distance is."""
AROUND = 128
"""Readings around, of which those beyond a distance predict it."""
CENTRES, MOST_LEFT_OUT = 256, 400
"""Readings whose predictions tell how good the law of a kriging is, and readings around one that are left out with it.
"""
BESIDE = 12
"""Of those, the nearest ones, which tell it about a pair of directions."""
TILTED = 0.1
"""Standard deviation of log f, at least, over a unit of ρ across the main law: about that of microfacet surfaces that
were read in the whole hemisphere. Readings in one plane leave it open."""
WORST, EXPECTED = 3, 2.73
"""The mean of so many largest ones of that many squares of normal numbers, which is expected: errors of kriging are
often larger than normal ones, and few of them tell."""
LARGEST = 0.95
"""Share of the directions whose distance from the nearest reading is no larger than the radius of what is left out."""


class SampleUncertainty:
    """Of a part of a table of scattered readings, both directions mirrored into the front hemisphere.

    Readings are predicted without those that are nearer to them than the nearest reading is to the directions that are
    asked for: readings that lie close together along one angle tell nothing of how f goes on to the next. Kriged
    values have the kriging's own standard error, larger where such predictions are worse than it says; means by
    distance have the largest error of such predictions around, or their difference from the nearest reading.
    """

    def __init__(self, table: Table, reciprocal: bool) -> None:
        self.kriging = kriging_of(table, reciprocal)
        block = table.samples()
        usable = (block.flag == Flag.VALID).all(axis=1)
        wi, wo = (Direction(*(np.asarray(c, float)[usable] for c in w)) for w in (block.wi, block.wo))
        f, u = (np.nan_to_num(np.asarray(a, float)[usable]) for a in (block.f, block.u_f))
        self.places = Places.of(wi, wo, reciprocal)
        self.reach = mirror_reach(table, 0.0)
        self.f, self.u = self.places.merged(f), np.sqrt(self.places.merged(u**2))

    def of(self, wi: Direction, wo: Direction, f: np.ndarray) -> Uncertain:
        """That of pairs of directions with components (n,), at which the interpolated values are f (n, C)."""
        if self.kriging is not None:
            return self._kriged(self.kriging, wi, wo)
        chunks = [slice(start, start + ROWS) for start in range(0, max(wi.z.size, 1), ROWS)]
        parts = []
        for rows in chunks:
            i, o = (Direction(*(c[rows] for c in w)) for w in (wi, wo))
            parts.append(self._by_distance(i, o, f[rows]))
        return Uncertain(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _by_distance(self, wi: Direction, wo: Direction, f: np.ndarray) -> Uncertain:
        distance, near = self.places.nearest(self.places.points(wi, wo), TELLING)
        # A mean of the nearest ones does not follow a slope; and where all around are alike, what readings farther away
        # add to it is all of its error.
        slope = self._slopes(near[:, 0]) * distance[:, :1] / RECTANGULAR
        between = np.maximum(slope, np.abs(f - self.f[near[:, 0]]))
        for k in range(near.shape[1]):
            error, spacing = self._left_out(near[:, k], distance[:, 0])
            share = np.minimum(distance[:, :1] / np.maximum(spacing[:, None], 1e-12), 1.0)
            part = np.multiply(share, error, out=np.zeros(error.shape), where=np.broadcast_to(share > 0, error.shape))
            between = np.maximum(between, part)
        # A lobe may hide where all readings around are farther from the mirror direction.
        away = from_mirror(self.places.points(wi, wo))
        around = np.min(from_mirror(self.places.read)[near], axis=1)
        between[(away < around) & (around > self.reach)] = np.inf
        return Uncertain(self.u[near[:, 0]], between)

    def _slopes(self, which: np.ndarray) -> np.ndarray:
        """The largest differences (n, C) of readings from those around over their distances."""
        distance, around = self.places.nearest(self.places.read[which], TELLING + 1)
        rise = np.abs(self.f[around] - self.f[which][:, None])
        return np.max(rise / np.maximum(distance, 1e-6)[:, :, None], axis=1)

    def _left_out(self, which: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Errors (n, C) of readings' predictions by those beyond a radius (n,), and distances to their nearest ones."""
        distance, around = self.places.nearest(self.places.read[which], AROUND)
        other = around != which[:, None]
        spacing = np.min(np.where(other, distance, np.inf), axis=1)
        far = other & (distance >= radius[:, None])
        far |= other & ~far.any(axis=1)[:, None] & (distance == np.max(np.where(other, distance, 0.0), axis=1)[:, None])
        weight = np.where(far, np.maximum(distance, 1e-6) ** -6.0, 0.0)
        total = np.sum(weight, axis=1)[:, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            predicted = np.einsum("nk,nkc->nc", weight, self.f[around]) / total
        return np.where(total > 0, np.abs(self.f[which] - predicted), np.inf), spacing

    def _kriged(self, kriging: FlooredKriging, wi: Direction, wo: Direction) -> Uncertain:
        """Those of kriging, which hold the noise of the readings."""
        used, system = kriging.system, Kriging.of(kriging.system.samples, _careful(kriging.system.law))
        radius = float(np.quantile(self.places.nearest(self.places.points(wi, wo), 1)[0], LARGEST))
        centres, missed = _predicted(system, self.places, radius)
        error, variance = system.left_out()
        every, parts = error**2 / variance[:, None], []
        for start in range(0, max(wi.z.size, 1), ROWS):
            directions = [Direction(*(c[start : start + ROWS] for c in w)) for w in (wi, wo)]
            covariance = system.covariances(*directions)
            value = used.predicted(*directions)
            worse = np.maximum(_of_worst(covariance, every), _of_worst(covariance[:, centres], missed))
            least = _variance(used, used.covariances(*directions))[:, None]
            square = np.maximum(worse * _variance(system, covariance)[:, None], least)
            square += (value - system.predicted(*directions)) ** 2
            value = np.clip(value, used.samples.values.min(0), used.samples.values.max(0))
            # Compressed values are asinh(f / 2 floor).
            parts.append(2 * kriging.floor * np.cosh(value) * np.sqrt(square))
        between = np.concatenate(parts)
        return Uncertain(np.zeros(between.shape), between)


class Places:
    """Where readings are, the exchanged directions too where these stand for the same; each place once."""

    def __init__(self, read: np.ndarray, exchanged: np.ndarray, place: np.ndarray, isotropic: bool) -> None:
        self.read, self.place, self.isotropic = read, place, isotropic
        self.tree = KDTree(np.concatenate([read, exchanged]))

    @classmethod
    def of(cls, wi: Direction, wo: Direction, reciprocal: bool) -> "Places":
        """Those of readings with components (n,)."""
        isotropic = one_azimuth(wi)
        points = np.round(_points(wi, wo, isotropic), 7)
        read, first, place = np.unique(points, axis=0, return_index=True, return_inverse=True)
        light, detector = (Direction(*(c[first] for c in w)) for w in (wo, wi))
        exchanged = _points(light, detector, isotropic) if reciprocal else np.zeros((0, 6))
        return cls(read, exchanged, place.ravel(), isotropic)

    def merged(self, values: np.ndarray) -> np.ndarray:
        """Means (places, C) of values (n, C) of the readings at each place."""
        count = np.bincount(self.place)
        return np.stack([np.bincount(self.place, column) / count for column in values.T], axis=1)

    def points(self, wi: Direction, wo: Direction) -> np.ndarray:
        """Those (n, 6) of directions with components (n,)."""
        return _points(wi, wo, self.isotropic)

    def nearest(self, points: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Distances (n, k) to the nearest readings, and their numbers; a reading may come twice, the second time
        exchanged."""
        distance, near = self.tree.query(points, min(number, self.tree.n))
        return distance.reshape(len(points), -1), near.reshape(len(points), -1) % len(self.read)


def from_mirror(points: np.ndarray) -> np.ndarray:
    """Angles (n,), radians, between wo and the mirror direction of wi, of components of both (n, 6)."""
    x, y, z, u, v, w = points.T
    return np.arccos(np.clip(z * w - x * u - y * v, -1.0, 1.0))


def _points(wi: Direction, wo: Direction, isotropic: bool) -> np.ndarray:
    """Components of both directions (n, 6), of an isotropic surface turned to one azimuth of the light."""
    if isotropic:
        sine = np.hypot(wi.x, wi.y)
        cos, sin = (np.where(sine > 1e-9, c / np.maximum(sine, 1e-300), one) for c, one in ((wi.x, 1), (wi.y, 0)))
        wi, wo = (rotate_z(w, cos, -sin) for w in (wi, wo))
    return np.stack([*wi, *wo], axis=-1)


def _careful(law: np.ndarray) -> np.ndarray:
    """A law by which f depends on where the half vector is tilted to, even where the readings did not show that."""
    tilt, remainder, variance = np.exp(law[4]), np.exp(law[6]), np.exp(law[8])
    careful = law.copy()
    careful[6] = np.log(max(remainder, TILTED**2 * tilt**2 / variance))
    return careful


def _predicted(system: Kriging, places: Places, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (m,) of some samples, and squares (m, C) of the errors of their prediction without those within a
    radius, over what the kriging says of them [Rasmussen & Williams 2006, section 5.4.2, of several left out at once].
    """
    n = len(system.lower)
    rng = np.random.default_rng(0)
    centres = np.sort(rng.choice(n, min(n, CENTRES), replace=False))
    precision = cho_solve((system.lower, True), np.eye(n), overwrite_b=True, check_finite=False)
    distance, around = places.nearest(places.read[places.place[centres]], MOST_LEFT_OUT)
    by_place = np.argsort(places.place, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(places.place))])
    missed = []
    for k, centre in enumerate(centres):
        there = np.unique(around[k][distance[k] <= radius])
        without = [by_place[starts[p] : starts[p + 1]] for p in [places.place[centre], *there]]
        without = np.unique(np.concatenate(without))[: n // 2]
        without = np.concatenate([[centre], without[without != centre]])
        inverse = np.linalg.inv(precision[np.ix_(without, without)])
        error = inverse[0] @ system.weights[without]
        missed.append(error**2 / inverse[0, 0])
    return centres, np.array(missed)


def _of_worst(covariance: np.ndarray, missed: np.ndarray) -> np.ndarray:
    """The mean (m, C) of the largest of squares (n, C) beside directions with these covariances (m, n), over that of
    normal numbers."""
    number = min(BESIDE, missed.shape[0])
    beside = np.argpartition(-covariance, number - 1, axis=1)[:, :number]
    worst = np.sort(missed[beside], axis=1)[:, -WORST:]
    return np.mean(worst, axis=1) / EXPECTED


def _variance(system: Kriging, covariance: np.ndarray) -> np.ndarray:
    """Expected square (m,) of the error of compressed values with these covariances (m, n) with the samples.

    The mean is estimated along with them [Rasmussen & Williams 2006, section 2.7].
    """
    remainder, nugget, whole = np.exp(system.law[6:])
    solved = solve_triangular(system.lower, covariance.T, lower=True, check_finite=False)
    ones = cho_solve((system.lower, True), np.ones(len(system.lower)), check_finite=False)
    of_mean = (1 - covariance @ ones) ** 2 / ones.sum()
    return np.maximum(whole * (1 + remainder) - np.sum(solved**2, axis=0), 0.0) + nugget * whole + of_mean
