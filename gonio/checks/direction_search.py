"""Pairs of directions all over the closed hemisphere at which a model is evaluated, and a search from the worst."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.evaluation import SMALL_BLOCK as BLOCK
from gonio.models.evaluation import evaluate_in_blocks, sampled_directions
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.horizon import Hemispheres
from gonio.models.geometry.low_discrepancy import low_discrepancy

values = evaluate_in_blocks
"""f of pairs, in calls of one size: one compilation serves all searches and integrals of a check."""

EDGE_ANGLES = np.radians([0.0, 1e-4, 0.5, 15, 30, 45, 60, 75, 85, 89, 89.9, 89.999, 90 - 1e-7])
NEAREST = 1e-12
"""Cosine of the most grazing direction: at the horizon itself f is 0 by definition."""

OPPOSITE = 1e-4
"""Least cosines of opposite grazing directions: wi + wo then keeps eleven digits."""


def precision() -> float:
    """Rounding of one operation in the precision that the caller's JAX works in."""
    return float(np.finfo(np.dtype(jnp.result_type(float))).eps)


def directions(theta: np.ndarray, phi: np.ndarray) -> Direction:
    """Unit directions of polar angles in [0, π/2] and azimuths, radians (NumPy, float64)."""
    return from_spherical(theta, phi, np)


def refuse_other_channels(judged: int, reference: int) -> None:
    """Raises GonioError where two numbers of channels differ and neither is one."""
    if judged != reference and 1 not in (judged, reference):
        raise GonioError(f"there are {judged} channels, and the reference has {reference}; compare equal ones, or grey")


def moved_by_rounding(w: Direction, rng: np.random.Generator) -> Direction:
    """Directions with every component moved by one unit in its last place: up, down or not at all, at random."""
    return Direction(*(c * (1 + precision() * rng.integers(-1, 2, np.shape(c))) for c in w))


PairMap = Callable[[Direction, Direction], tuple[Direction, Direction]]
"""The partner of a pair of directions, at which f should be the same."""


def rotated(azimuth: float) -> PairMap:
    """Turns both directions about the normal by an azimuth, radians."""
    c, s = np.cos(azimuth), np.sin(azimuth)

    def turn(w: Direction) -> Direction:
        return Direction(w.x * c - w.y * s, w.x * s + w.y * c, w.z)

    return lambda wi, wo: (turn(wi), turn(wo))


def swapped(wi: Direction, wo: Direction) -> tuple[Direction, Direction]:
    """The reciprocal pair."""
    return wo, wi


def mirrored(wi: Direction, wo: Direction) -> tuple[Direction, Direction]:
    """Both directions mirrored at the plane of x and the normal."""
    return Direction(wi.x, -wi.y, wi.z), Direction(wo.x, -wo.y, wo.z)


def everywhere(u: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(n, 4) angles of pairs: polar ones (n, 2) as given, azimuths of the second and fourth of points u (n, 4)."""
    return np.stack([theta[:, 0], 2 * np.pi * u[:, 1], theta[:, 1], 2 * np.pi * u[:, 3]], -1)


def pair_angles(brdf: AbstractBRDF) -> np.ndarray:
    """(n, 4) of theta_i, phi_i, theta_o, phi_o: everywhere, on the edges, and where the model says its lobes are."""
    u = low_discrepancy(3 * BLOCK // 4, 4)
    # Half of them even in solid angle, half even in the polar angles' own logarithmic distance from the horizon.
    theta = np.where(
        (np.arange(len(u)) % 2 == 0)[:, None],
        np.arccos(1 - u[:, [0, 2]]),
        np.pi / 2 - np.pi / 2 * 10 ** (-8 * u[:, [0, 2]]),
    )
    azimuths = np.array([0.0, 1e-3, np.pi / 2, np.pi - 1e-3, np.pi])
    grid = np.stack(np.meshgrid(EDGE_ANGLES, [0.3], EDGE_ANGLES, 0.3 + azimuths, indexing="ij"), -1).reshape(-1, 4)
    return np.concatenate([everywhere(u, theta), grid, *_near_lobes(brdf)])


def _near_lobes(brdf: AbstractBRDF) -> list[np.ndarray]:
    # Towards the mirror and back to the light at distances over eight decades, and where the sampler sends light.
    u = low_discrepancy(600, 4, 0.25)
    theta_i = np.where(u[:, 0] < 0.5, np.pi * u[:, 0], np.pi / 2 - np.pi / 2 * 10 ** (-6 * (2 * u[:, 0] - 1)))
    phi_i = 2 * np.pi * u[:, 1]
    distance = 10 ** (-8 * u[:, 2])
    theta_o = np.clip(theta_i + distance * np.cos(2 * np.pi * u[:, 3]), 0, np.pi / 2)
    turn = distance * np.sin(2 * np.pi * u[:, 3]) / np.maximum(np.sin(theta_i), 0.05)
    angles = [np.stack([theta_i, phi_i, theta_o, phi_i + away + turn], -1) for away in (0.0, np.pi)]
    for term in brdf.terms():
        theta, phi = sampled_angles(term, theta_i, phi_i)
        if Hemispheres.TRANSMISSION in term.hemispheres:  # light and detector on any sides stand for those in front
            theta = np.minimum(theta, np.pi - theta)
        angles.append(np.stack([theta_i, phi_i, theta, phi], -1)[theta < np.pi / 2])
    return angles


def sampled_angles(brdf: AbstractBRDF, theta_i: np.ndarray, phi_i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(theta_o, phi_o) of one direction from the model's sampler for each incidence; π where it has none."""
    try:
        wo = sampled_directions(brdf, directions(theta_i, phi_i), *low_discrepancy(theta_i.size, 2, 0.75).T)
    except NotImplementedError:  # how a model says that it has no sampler; any other failure is an error of its own
        return np.full(theta_i.shape, np.pi), np.zeros(theta_i.shape)
    x, y, z = (np.asarray(c, float) for c in wo)
    theta = np.where(np.isfinite(z), np.arctan2(np.hypot(x, y), z), np.pi)
    return np.nan_to_num(theta, nan=np.pi), np.nan_to_num(np.arctan2(y, x))


def pair(angles: np.ndarray) -> tuple[Direction, Direction]:
    """(wi, wo) of rows of angles; no cosine is below `NEAREST`, so that every pair is above the horizon.

    Of directions that are opposite to each other at the horizon the half vector is lost in rounding: their cosines
    are at least `OPPOSITE`.
    """
    wi, wo = (directions(angles[:, k], angles[:, k + 1]) for k in (0, 2))
    opposite = np.hypot(wi.x + wo.x, wi.y + wo.y) + wi.z + wo.z < 4 * OPPOSITE
    least = np.where(opposite, OPPOSITE, NEAREST)
    return _above(wi, least), _above(wo, least)


def _above(w: Direction, least: np.ndarray) -> Direction:
    # Still of unit length: a model that holds wi·h and wo·h for the same must not be blamed for our directions.
    z = np.maximum(w.z, least)
    shrunk = np.where(w.z < least, np.sqrt((1 - z * z) / np.maximum(w.x**2 + w.y**2, 1e-300)), 1.0)
    return Direction(w.x * shrunk, w.y * shrunk, z)


def climb(
    objective: Callable[[np.ndarray], np.ndarray], starts: np.ndarray, rounds: int = 24
) -> tuple[np.ndarray, np.ndarray]:
    """Local search from rows of angles for a larger objective: the best angles of each start and their values.

    Random steps about each start, narrowing where no step gains [an evolution strategy, Rechenberg 1973]; it needs no
    gradient, and all starts go through one compiled call.
    """
    rng = np.random.default_rng(0)
    best, value = starts.copy(), objective(starts)
    trials = BLOCK // 2 // len(starts)
    size = np.full((len(starts), 1, 1), 0.1)
    for _ in range(rounds):
        spread = size * 10 ** (-2 * rng.random((len(starts), trials, 1)))
        trial = best[:, None] + spread * rng.standard_normal((len(starts), trials, 4))
        trial[..., ::2] = np.abs(trial[..., ::2])
        trial[..., ::2] = np.minimum(trial[..., ::2], np.pi - trial[..., ::2])
        trial_value = objective(trial.reshape(-1, 4)).reshape(len(starts), trials)
        better = keep_best(best, value, trial, trial_value)
        size[~better] /= 4
    return best, value


def keep_best(best: np.ndarray, value: np.ndarray, trial: np.ndarray, trial_value: np.ndarray) -> np.ndarray:
    """Replaces, in place, the best (n, k) and value (n,) of each start by its largest trial (n, m, k); where it did."""
    number = np.arange(len(best))
    k = np.argmax(np.nan_to_num(trial_value, nan=-np.inf), axis=1)
    better = trial_value[number, k] > value
    best[better], value[better] = trial[better, k[better]], trial_value[better, k[better]]
    return better
