"""Which further readings would tell apart what the present ones leave open."""

import jax.numpy as jnp
import numpy as np

from gonio.fitting.problem.normal_equations import lobes_at
from gonio.fitting.problem.parameterisation import Structure
from gonio.fitting.problem.readings import Readings
from gonio.fitting.solver.initial_guess import GUESS_SAMPLES
from gonio.fitting.solver.robust_weights import NORMAL_MAD
from gonio.fitting.uncertainty.covariance import LOST, open_from
from gonio.models.geometry.directions import Direction

STEP = 5.0  # degrees
HIGHEST = 85.0
INCIDENCES = 16
LEAST_NOISE = 1e-3  # of f: what readings without noise are taken to have
SETTLED = 1 / 16  # variance of what is told apart: a quarter of the uncertainty that counts as open
MANY = 200.0  # times as many readings: beyond that nobody measures


def advice(e, k: int, readings: Readings) -> str:
    """What would determine the k-th open combination of an ending `e`, as a clause.

    Readings at a grid of directions, with the noise of readings as bright as these, are added to what is known of all
    numbers together, in order of their larger polar angle: the first angle up to which the combination's variance falls
    below what counts as open is the answer.
    """
    variance, change = e.covariance.combinations[k]
    s, p = e.structure, e.p
    theta_i, theta_o, rows, f = _probes(s, p, e.fixed)
    sigma = _noise(readings, e.model_f, f)
    known = _precision(e)
    reach = open_from(e.domains, p)
    top = float(np.degrees(np.max(np.arccos(np.clip(np.minimum(readings.wi.z, readings.wo.z), 0, 1)))))
    outer = np.degrees(np.maximum(theta_i, theta_o))
    for angle in np.arange(STEP * (np.floor(top / STEP + 0.01) + 1), HIGHEST + 1e-9, STEP):
        at = (outer > top + 0.1 * STEP) & (outer <= angle + 1e-6)
        if at.any() and _settled(known + _information(s, rows[at], sigma[at]), reach, change):
            gain = np.sum((_along(s, rows, change) / sigma) ** 2, axis=1) * at
            best = int(np.argmax(gain))
            where = f"θi {np.degrees(theta_i[best]):.0f}°, θo {np.degrees(theta_o[best]):.0f}°"
            return f"readings up to {angle:.0f}° (these end at {top:.0f}°) would separate them, most of all at {where}"
    inside = outer <= top + 0.1 * STEP
    if inside.any() and _settled(known + _information(s, rows[inside], sigma[inside]), reach, change):
        return "readings at all azimuths, at polar angles as these, would separate them"
    if variance / SETTLED < MANY:
        return f"no angles separate them, {np.ceil(variance / SETTLED):.0f} times as many readings would"
    return "no readings would separate them: hold one of them at a known value (name=value)"


def _settled(matrix: np.ndarray, reach: np.ndarray, change: np.ndarray) -> bool:
    """Whether the combination's variance, in units of what counts as open, is well below 1, all numbers being free."""
    direction = change / np.linalg.norm(change / reach) / reach**2
    held = np.diagonal(matrix) > 0
    if np.abs(change / reach)[~held].max(initial=0.0) > 0.1 * np.abs(change / reach).max():
        return False
    lengths = np.sqrt(np.diagonal(matrix)[held])
    values, vectors = np.linalg.eigh(matrix[np.ix_(held, held)] / np.outer(lengths, lengths))
    along = vectors.T @ (direction[held] / lengths)
    lost = values < LOST * values.size
    if np.abs(along[lost]).max(initial=0.0) > 1e-3 * np.linalg.norm(along):
        return False
    return bool(np.sum(along[~lost] ** 2 / values[~lost]) < SETTLED)


def _precision(e) -> np.ndarray:
    """Inverse covariance (P, P) of the open numbers: the normal matrix over the residuals' own variance."""
    matrix = np.asarray(e.total.matrix, float)
    free = ~e.pinned
    if e.exact:
        # Without noise everything that is seen at all is determined: as much is taken as the further readings have.
        return np.where(np.outer(free, free), matrix, 0.0) / (
            LEAST_NOISE**2 * max(e.target_norm_squared, 1e-300) / e.model_f.size
        )
    known = np.diagonal(e.covariance.matrix)
    seen = np.isfinite(known) & (known > 0)
    # Where the covariance is not the inverse of the matrix (robust, or noise not known) their ratio is the variance.
    scale = 1.0
    if seen.any():
        inverse = np.linalg.pinv(matrix[np.ix_(seen, seen)], rcond=1e-14, hermitian=True)
        scale = float(np.median(known[seen] / np.maximum(np.diagonal(inverse), 1e-300)))
    return np.where(np.outer(free, free), matrix, 0.0) / max(scale, 1e-300)


def _probes(s: Structure, p: np.ndarray, fixed):
    """(θi, θo (n,), rows (n, groups, C), f (n, C)) at incidences every few degrees: in the plane and out of it."""
    each = GUESS_SAMPLES // INCIDENCES
    incidence = np.radians(np.append(np.arange(10, 86, STEP)[: INCIDENCES - 1], HIGHEST))
    polar = np.radians(np.linspace(2.5, HIGHEST, each // 4))
    theta_i = np.repeat(incidence, each)
    theta_o = np.tile(np.tile(polar, 4), INCIDENCES)
    phi = np.tile(np.repeat(np.radians([180.0, 0.0, 175.0, 120.0]), each // 4), INCIDENCES)
    # The mirror direction itself belongs to every incidence: a lobe is often narrower than the grid.
    theta_o[:: each // 4] = theta_i[:: each // 4]
    wi = Direction(np.sin(theta_i), np.zeros_like(theta_i), np.cos(theta_i))
    wo = Direction(np.sin(theta_o) * np.cos(phi), np.sin(theta_o) * np.sin(phi), np.cos(theta_o))
    wi, wo = (Direction(*(jnp.asarray(c) for c in w)) for w in (wi, wo))
    f, rows = (np.asarray(a) for a in lobes_at(s, jnp.asarray(p), fixed, wi, wo))
    return theta_i, theta_o, rows, f


def _along(s: Structure, rows: np.ndarray, change: np.ndarray) -> np.ndarray:
    """∂f along a change of the numbers, (n, C)."""
    return np.stack([rows[:, :, c] @ change[s.columns(c)] for c in range(s.channels)], axis=1)


def _information(s: Structure, rows: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    found = np.zeros((s.size, s.size))
    for c in range(s.channels):
        j = rows[:, :, c] / sigma[:, c : c + 1]
        found[np.ix_(s.columns(c), s.columns(c))] += j.T @ j
    return found


def _noise(readings: Readings, model: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Standard deviation of readings as bright as f, (n, C), from the residuals of 16 classes of brightness."""
    valid = readings.valid & (np.abs(model) > 0)
    level, off = np.abs(model[valid]), np.abs((readings.f - model)[valid])
    if level.size < 2:
        return LEAST_NOISE * np.maximum(np.abs(f), 1e-30)
    order = np.array_split(np.argsort(level), min(16, level.size))
    x = np.array([np.median(level[o]) for o in order])
    share = np.array([NORMAL_MAD * np.median(off[o]) for o in order]) / x
    size = np.maximum(np.abs(f), 1e-3 * x[0] + 1e-300)
    return np.maximum(np.interp(np.log(size), np.log(x), share), LEAST_NOISE) * size
