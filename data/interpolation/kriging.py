"""Kriging of scattered samples: their compressed values are correlated over the tilt of the half vector.

Values are compressed by asinh(f / 2f₀), a logarithm above the floor f₀. They vary together by Matérn's law (ν = 5/2)
over ρ = asinh(tan θh / s) and θd, and a remainder of them over these and over where the half vector is tilted to. The
width s, the lengths and the variances are the likeliest ones [Rasmussen & Williams 2006, section 5.4.1].
"""

import dataclasses
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.optimize import minimize

from gonio.models.geometry.directions import Direction

SAMPLES, CHANNELS = 200, 4
"""Whose likelihood decides the law."""
FIRST_STEPS, STEPS = 12, 60
"""Of the search: from every start, and on from the best end."""
NAMES = ("width", "across", "rho", "theta_d", "tilt", "turn", "remainder", "nugget", "variance")
"""Of a law's numbers. Width and across: s of the half vector's slopes along x, and along y relative to that; then
lengths; then shares of the variance: of the remainder, and of what no neighbour tells."""
LOW = np.log([1e-5, 0.05, 0.05, 0.05, 0.1, 0.05, 1e-5, 1e-9, 1e-8])
HIGH = np.log([3.0, 20.0, 100.0, 50.0, 100.0, 50.0, 10.0, 0.1, 1e4])
STARTS = tuple(np.log([s, 1.0, 4.0, 2.0, 8.0, 2.0, 0.1, 1e-5, 1.0]) for s in (0.01, 0.1, 0.4))
"""From narrow, usual and wide lobes."""
STEP = 1e-6
"""Of a logarithm, for derivatives."""
TINY = 1e-24
STEEPEST = 1e-3
"""Height of a facet that refracts, over its tilt, at least."""


class Places(NamedTuple):
    """Where pairs of directions are, in lengths of a law: ρ and θd (n, 2); how h is tilted (n, 2), or (n, 4)."""

    main: Any
    tilted: Any


class Symmetry(NamedTuple):
    """Which pairs of directions share a place: exchanged ones (reciprocity), turned and mirrored ones (isotropy).

    What goes through a sample, lit from one side, is not the same exchanged. `index`: the refractive one on the
    detector's side over that on the light's, so that what facets refract peaks as what they mirror does.
    """

    isotropic: bool
    reciprocal: bool = True
    index: float = 1.0


def places(wi: Direction, wo: Direction, law: Any, symmetry: Symmetry, xp: ModuleType) -> Places:
    """The places of pairs of directions with components (n,), both mirrored into the front, by `numpy` or `jax.numpy`.

    Those that are the same by the symmetry share one.
    """
    isotropic = symmetry.isotropic
    wo = Direction(*(symmetry.index * c for c in wo)) if symmetry.index != 1.0 else wo
    width, across, of_rho, of_d, of_tilt, of_turn = (xp.exp(law[k]) for k in range(6))
    s = Direction(*(a + b for a, b in zip(wi, wo, strict=True)))
    d = Direction(*(a - b for a, b in zip(wi, wo, strict=True)))
    s2, d2 = (xp.maximum(w.x**2 + w.y**2 + w.z**2, TINY) for w in (s, d))
    graze = xp.arcsinh(xp.sqrt(d2 / s2))
    z = (xp.maximum(s.z, 1e-12) if symmetry.index == 1.0 else _refracting(wi, wo, symmetry.index, xp)) * width
    x, y = s.x / z, s.y / (z if isotropic else z * across)
    slope = xp.sqrt(xp.maximum(x * x + y * y, TINY))
    rho = xp.arcsinh(slope)
    if isotropic:
        flat_s = xp.sqrt(xp.maximum(s.x**2 + s.y**2, TINY))
        if symmetry.reciprocal:
            cos_phi = xp.minimum(xp.abs(d.z) / xp.sqrt(d2 / s2) / flat_s, 1.0)  # of the difference angle's azimuth
        else:
            flat_d = xp.sqrt(xp.maximum(d.x**2 + d.y**2, TINY))
            cos_phi = xp.clip((s.x * d.x + s.y * d.y) / (flat_s * flat_d), -1.0, 1.0)
        tilted = [rho * cos_phi / of_tilt, rho * xp.sqrt(1 - cos_phi**2) / of_tilt]
    else:
        flat = xp.sqrt(xp.maximum(d.x**2 + d.y**2, TINY)) * of_turn
        if symmetry.reciprocal:
            # Twice the azimuth of wi − wo: the same for both orders of the directions.
            turned = [(d.x**2 - d.y**2) / flat, 2 * d.x * d.y / flat]
        else:
            turned = [d.x / of_turn, d.y / of_turn]
        tilted = [rho * x / slope / of_tilt, rho * y / slope / of_tilt, *turned]
    return Places(xp.stack([rho / of_rho, graze / of_d], -1), xp.stack(tilted, -1))


def _refracting(wi: Direction, wo: Direction, index: float, xp: ModuleType) -> Any:
    """Height of the facet that refracts, over its tilt; where none does, and f of an interface is 0, the steepest.

    `wo`: of the length of the index.
    """
    return xp.maximum(wo.z - wi.z if index > 1.0 else wi.z - wo.z, STEEPEST)


def correlation(a: Places, b: Places, remainder: Any, xp: ModuleType) -> Any:
    """(n, m) covariances between places, in units of the main part's variance."""
    near = _squares(a.main, b.main, xp)
    return _matern(near, xp) + remainder * _matern(near + _squares(a.tilted, b.tilted, xp), xp)


def _squares(a: Any, b: Any, xp: ModuleType) -> Any:
    whole = xp.sum(a * a, -1)[:, None] + xp.sum(b * b, -1)[None] - 2 * a @ b.T
    return xp.maximum(whole, 0.0)


def _matern(squares: Any, xp: ModuleType) -> Any:
    r = xp.sqrt(5 * squares + TINY)
    return (1 + r + squares * (5 / 3)) * xp.exp(-r)


class Samples(NamedTuple):
    """Samples to be kriged: directions of NumPy components (n,), compressed values (n, C), variances of noise (n,)."""

    wi: Direction
    wo: Direction
    values: np.ndarray
    noise: np.ndarray
    symmetry: Symmetry

    def part(self, which: np.ndarray) -> "Samples":
        """Some of them."""
        wi, wo = (Direction(*(c[which] for c in w)) for w in (self.wi, self.wo))
        return self._replace(wi=wi, wo=wo, values=self.values[which], noise=self.noise[which])


@dataclasses.dataclass(frozen=True)
class Kriging:
    """The solved system of some samples and a law.

    `lower` is the Cholesky factor of their covariances (n, n); `weights` (n, C) and `mean` (C,) predict.
    """

    samples: Samples
    law: np.ndarray
    here: Places
    lower: np.ndarray
    weights: np.ndarray
    mean: np.ndarray

    @classmethod
    def of(cls, samples: Samples, law: np.ndarray) -> "Kriging":
        """Solves the system. Raises numpy.linalg.LinAlgError where it cannot be."""
        here = places(samples.wi, samples.wo, law, samples.symmetry, np)
        k = _covariance(here, samples.noise, law)
        lower = cholesky(k, lower=True, overwrite_a=True, check_finite=False)
        solution = cho_solve((lower, True), np.column_stack([samples.values, np.ones(len(k))]), check_finite=False)
        mean = solution[:, :-1].sum(axis=0) / solution[:, -1].sum()
        return cls(samples, law, here, lower, solution[:, :-1] - solution[:, -1:] * mean, mean)

    def predicted(self, wi: Direction, wo: Direction) -> np.ndarray:
        """Compressed values (m, C) at pairs of directions with components (m,)."""
        return self.mean + self.covariances(wi, wo) @ self.weights

    def covariances(self, wi: Direction, wo: Direction) -> np.ndarray:
        """(m, n): of pairs of directions with the samples."""
        there = places(wi, wo, self.law, self.samples.symmetry, np)
        return np.exp(self.law[8]) * correlation(there, self.here, np.exp(self.law[6]), np)

    def left_out(self) -> tuple[np.ndarray, np.ndarray]:
        """(error (n, C) of each sample's prediction by all others, its expected variance (n,))."""
        inverse = cho_solve((self.lower, True), np.eye(len(self.lower)), overwrite_b=True, check_finite=False)
        precision = np.diagonal(inverse)
        return self.weights / precision[:, None], 1 / precision


def likeliest(samples: Samples, start: np.ndarray | None = None) -> np.ndarray:
    """The law of the largest likelihood, of some of the samples if they are many; the search starts from a law."""
    count = len(samples.noise)
    if count > SAMPLES:
        samples = samples.part(np.sort(np.random.default_rng(0).choice(count, SAMPLES, replace=False)))
    channels = np.unique(np.linspace(0, samples.values.shape[1] - 1, CHANNELS).round().astype(int))
    samples = samples._replace(values=samples.values[:, channels])
    spread = max(float(np.mean(np.var(samples.values, axis=0))), 1e-6)
    if start is not None:
        return _climbed(start, samples, STEPS)[1]
    usual = np.log(spread) * (np.arange(len(NAMES)) == len(NAMES) - 1)
    ends = [_climbed(law + usual, samples, FIRST_STEPS) for law in STARTS]
    return _climbed(min(ends, key=lambda end: end[0])[1], samples, STEPS)[1]


def _climbed(law: np.ndarray, samples: Samples, steps: int) -> tuple[float, np.ndarray]:
    bounds = list(zip(LOW, HIGH, strict=True))
    start, options = np.clip(law, LOW, HIGH), {"maxiter": steps}
    end = minimize(_unlikelihood, start, (samples,), "L-BFGS-B", True, bounds=bounds, options=options)
    return float(end.fun), end.x


def _covariance(here: Places, noise: np.ndarray, law: np.ndarray) -> np.ndarray:
    k = np.exp(law[8]) * correlation(here, here, np.exp(law[6]), np)
    k[np.diag_indices(len(k))] += np.exp(law[7] + law[8]) + noise
    return k


def _unlikelihood(law: np.ndarray, samples: Samples) -> tuple[float, np.ndarray]:
    """−log likelihood, the mean profiled, and its gradient by the law."""
    here = places(samples.wi, samples.wo, law, samples.symmetry, np)
    remainder, nugget, variance = np.exp(law[6:])
    near = _squares(here.main, here.main, np)
    main, main_slope = (variance * a for a in _matern_and_slope(near))
    far = _matern_and_slope(near + _squares(here.tilted, here.tilted, np))
    rest, rest_slope = (variance * remainder * a for a in far)
    k = main + rest
    k[np.diag_indices(len(k))] += nugget * variance + samples.noise
    try:
        lower = cholesky(k, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return 1e12, np.zeros(law.size)
    inverse = cho_solve((lower, True), np.eye(len(k)), check_finite=False)
    ones = inverse.sum(axis=1)
    solved = inverse @ samples.values
    solved -= np.outer(ones, solved.sum(axis=0) / ones.sum())
    channels = samples.values.shape[1]
    value = 0.5 * np.sum(samples.values * solved) + channels * np.sum(np.log(np.diagonal(lower)))
    slope = 0.5 * (channels * inverse - solved @ solved.T)  # by the elements of k
    by_far = slope * rest_slope
    by_near = slope * main_slope + by_far
    by_place = [4 * (w.sum(axis=1)[:, None] * x - w @ x) for w, x in zip((by_near, by_far), here, strict=True)]
    gradient = np.zeros(law.size)
    for number in range(6):
        moved = law.copy()
        moved[number] += STEP
        there = places(samples.wi, samples.wo, moved, samples.symmetry, np)
        gradient[number] = sum(np.sum(g * (b - a)) for g, a, b in zip(by_place, here, there, strict=True)) / STEP
    diagonal = np.trace(slope) * nugget * variance
    gradient[6:] = np.sum(slope * rest), diagonal, np.sum(slope * (main + rest)) + diagonal
    return float(value), gradient


def _matern_and_slope(squares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matérn's law, and its derivative by the squared distance."""
    r = np.sqrt(5 * squares)
    decay = np.exp(-r)
    slope = (1 + r) * decay
    return slope + squares * (5 / 3) * decay, (-5 / 6) * slope
