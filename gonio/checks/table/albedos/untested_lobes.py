"""Lobes of a fitted model whose shape the readings do not test: what the model says between them is a guess.

A height and a width are two numbers. A lobe narrower than the grid shows its peak, and perhaps its foot at one node:
every family of lobes agrees with both, each with another width, and up to three times another's light. A third level,
between or beyond them, shows whether the family is right.
"""

import numpy as np

from gonio.checks.hidden_lobes import Further
from gonio.checks.table.albedos.model_light import FAST, albedos_at, light_of
from gonio.checks.table.albedos.on_grid import HemisphereGrid
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

LEVELS = 3
"""E-folds below a lobe's peak at which it is read, different ones, from which on its shape is tested."""
VISIBLE = 0.05
"""Share of f from which on a lobe counts as read; noise may ask for more."""
NOISE = 3.0
"""Standard uncertainties of a reading that a lobe exceeds where it counts as read."""
UNRESOLVED = 0.1
"""Of a lobe's light, that the grid's own rule misses."""
FACTOR = 3.0
"""Of its light, by which a lobe of another family may differ that has the same peak and foot: one that falls as
exp(−rᵖ) to e⁻⁷ has 0.3 of a Gaussian's light at p = 1 and 2.3 times it at p = 4."""


def untested_light(brdf: AbstractBRDF, grid: HemisphereGrid, u: np.ndarray, further: Further | None) -> np.ndarray:
    """What the albedos of a model may be off by, because nothing read tests its lobes, (incidences, C).

    Args:
        brdf: the fitted model.
        grid: of the readings.
        u: their standard uncertainties, (incidences, θo, azimuth, C); 0 where unknown.
        further: further readings to which the model was fitted.
    """
    incidences = np.array([(t, p) for _, t, p in grid.incidences])
    shape = (len(incidences), grid.theta_o.size, grid.azimuth.size)
    nodes = np.stack(
        [
            *(np.broadcast_to(a[:, None, None], shape) for a in incidences.T),
            *(np.broadcast_to(a, shape) for a in (grid.theta_o[:, None], grid.azimuth)),
        ],
        axis=-1,
    ).reshape(-1, 4)
    channels = u.shape[-1]
    angles, noise = nodes, u.reshape(-1, channels).max(axis=1)
    if further is not None:
        angles, noise = np.concatenate([angles, further.angles]), np.concatenate([noise, further.u.max(axis=1)])
    f = _f(brdf, angles)
    of_light = np.argmin(np.abs(angles[:, :1] - incidences[:, 0]), axis=1)
    total = np.zeros((len(incidences), channels))
    for term in brdf.terms():
        there = _f(term, angles)
        read = (there > VISIBLE * f) & (there > NOISE * noise) & (there > 0)
        below = np.log(_peaks(term, incidences)[of_light[read]] / there[read])
        if np.unique(np.floor(np.maximum(below, 0.0))).size >= LEVELS:
            continue
        light = albedos_at(term, from_spherical(incidences[:, 0], incidences[:, 1], np), FAST, channels)
        by_grid = np.sum(grid.weights[..., 0] * there[: len(nodes)].reshape(shape), axis=(1, 2))
        missed = np.abs(by_grid[:, None] - light.mean(axis=1, keepdims=True)) > UNRESOLVED * light
        total += np.where(missed, FACTOR * light, 0.0)
    return total


def _f(brdf: AbstractBRDF, angles: np.ndarray) -> np.ndarray:
    """f, the mean of the channels, at angles (n, 4)."""
    wi, wo = (from_spherical(angles[:, k], angles[:, k + 1], np) for k in (0, 2))
    return np.asarray(evaluate(brdf, wi, wo)).reshape(len(angles), -1).mean(axis=1)


def _peaks(term: AbstractBRDF, incidences: np.ndarray) -> np.ndarray:
    """The largest f of a term at each incidence (n,), among the directions of its lobe map and the mirror one."""
    peaks = []
    for theta, phi in incidences:
        wi = Direction(*(np.asarray(c) for c in from_spherical(theta, phi, np)))
        ((wo, _),) = light_of(term, wi, FAST)
        up = np.asarray(wo.z) > 0
        polar = np.append(np.arccos(np.clip(np.asarray(wo.z)[up], 0, 1)), theta)
        azimuth = np.append(np.arctan2(np.asarray(wo.y)[up], np.asarray(wo.x)[up]), phi + np.pi)
        light = np.broadcast_to([theta, phi], (polar.size, 2))
        peaks.append(np.max(_f(term, np.column_stack([light, polar, azimuth]))))
    return np.maximum(np.array(peaks), np.finfo(float).tiny)
