"""Lobes of a fitted model whose shape the readings do not test, or show to be another: their light is a guess.

A height and a width are two numbers. A lobe narrower than the grid shows its peak, and perhaps its foot at one node:
every family of lobes agrees with both, each with another width, and up to three times another's light. A third level,
between or beyond them, shows whether the family is right; a family of more numbers needs as many more.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from gonio.checks.grid_resolution import LARGEST
from gonio.checks.table.albedos.model_light import FAST, LobeSamples, lobe_samples
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

LEVELS = 3
"""E-folds below a lobe's peak at which it is read, different ones, from which on the shape of one width is tested."""
VISIBLE = 0.05
"""Share of f from which on a lobe counts as read; noise may ask for more."""
NOISE = 3.0
"""Standard uncertainties of a reading that a lobe exceeds where it counts as read."""
FACTOR = 3.0
"""Of its light, by which a lobe of another family may differ that has the same peak and foot: one that falls as
exp(−rᵖ) to e⁻⁷ has 0.3 of a Gaussian's light at p = 1 and 2.3 times it at p = 4."""
FLAT = float(np.sqrt(np.pi) / 2)
"""Light of a lobe that falls as exp(−r⁴) to e⁻ᵈ at its foot, over its peak, the area up to there, and d^(−½)."""
ANOTHER = 0.1
"""Misfit of readings on a lobe that shows another family: between the levels read it may then be off twice as much."""
STEP, DEEPEST = 0.5, 40.0
"""E-folds of one class of readings, and below which nothing matters."""
APART = 0.01
"""E-folds by which readings are at several depths of a lobe, not mirror images of each other."""
SAME_LIGHT = np.radians(0.05)
MOST = 1 << 16
"""Readings that are looked at, evenly spaced among all."""
SHAPES = frozenset({"width", "inverse_width", "roughness", "shoulder", "hot_spot", "exponent"})
"""Roles of the numbers that give a lobe its shape."""


class LobeReadings(NamedTuple):
    """What tests the lobes of a model: angles (n, 4), radians, f and its standard uncertainty (n, C); 0 if unknown."""

    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray

    def joined(self, other: "LobeReadings") -> "LobeReadings":
        """Both."""
        return LobeReadings(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    @property
    def thinned(self) -> "LobeReadings":
        """At most `MOST` of them, evenly spaced."""
        step = -(-len(self.f) // MOST)
        return LobeReadings(*(a[::step] for a in self))


class Lobe(NamedTuple):
    """One term of a model, its number among them, and what it sends where at each of the incidences."""

    number: int
    term: AbstractBRDF
    samples: list[LobeSamples]

    def light(self, channels: int) -> np.ndarray:
        """Its albedo, (incidences, C)."""
        return np.stack([np.broadcast_to(s.light.sum(axis=0), channels) for s in self.samples])


Resolved = Callable[[Lobe], np.ndarray]
"""Whether the readings' own rule integrates a lobe at each of the incidences, (incidences, C)."""


Nodes = Callable[[Lobe, int], tuple[np.ndarray, np.ndarray]]


class LobeTest(NamedTuple):
    """What the readings tell of a lobe that their own rule does not integrate.

    Attributes:
        lobe: the lobe.
        off: what its light may be off by at each incidence, (incidences, C), the noise apart; 0 where the rule does
            integrate it.
        by_readings: the same with the noise of the readings on it, whatever the uncertainty of the fit.
        tested: whether its shape is tested, and it is read at each incidence itself near its peak and below it.
    """

    lobe: Lobe
    off: np.ndarray
    by_readings: np.ndarray
    tested: np.ndarray


def lobe_tests(
    brdf: AbstractBRDF, incidences: np.ndarray, readings: LobeReadings, resolved: Resolved, nodes: Nodes | None = None
) -> list[LobeTest]:
    """Of each lobe of a model that needs a test, whether it has one, and what it may be off by.

    Args:
        brdf: the fitted model.
        incidences: theta_i, phi_i, radians, (incidences, 2).
        readings: all to which the model was fitted.
        resolved: what needs no test.
        nodes: of a lobe at an incidence f (n, C) at the nodes of its rule, and their projected solid angles (n,), sr;
            None where the rule is none of nodes.
    """
    terms = brdf.terms()
    if not terms:
        return []
    values = [values_at(term, readings.angles) for term in terms]
    model = np.sum(np.broadcast_arrays(*values), axis=0)
    misfits, whole, noise = np.abs(readings.f - model), model.mean(axis=1), NOISE * readings.u.max(axis=1)
    tests: list[LobeTest] = []
    for number, (term, value) in enumerate(zip(terms, values, strict=True)):
        lobe = Lobe(number, term, [lobe_samples(term, _light_from(i), FAST) for i in incidences])
        unresolved, there = ~resolved(lobe), value.mean(axis=1)
        if not unresolved.any():
            continue
        read = (there > VISIBLE * whole) & (there > noise) & (there > 0)
        below, beside = _below_peak(lobe, incidences, readings.angles[read], there[read])
        tested = np.zeros(len(incidences), bool)
        known = np.full((len(incidences), readings.f.shape[1]), np.inf)
        levels_read = np.unique(np.floor(below))
        in_body = levels_read <= _body_depth(lobe)
        if np.count_nonzero(in_body) < LEVELS - 1 + max(shape_numbers(term), 1):
            light = lobe.light(readings.f.shape[1])
            off = np.maximum(FACTOR * light, _flat_light(lobe, incidences, readings.angles[:, 0], there, whole) - light)
        else:
            limits = (
                np.maximum(misfits + sign * NOISE * readings.u, 0.0)[read] / there[read, None] for sign in (-1, 1)
            )
            same = np.abs(readings.angles[read, 0] - incidences[beside, 0]) < SAME_LIGHT
            levels = [_by_level(below, np.where(same, beside, -1 - beside), limit) for limit in limits]
            each = [[_of_incidence(k, by_level) for k in range(len(incidences))] for by_level in levels]
            pairs = enumerate(zip(lobe.samples, *each, strict=True))
            both = [(_missed(s, m, nodes and nodes(lobe, k)), _missed(s, n, None)) for k, (s, m, n) in pairs]
            off, known = (np.stack(of_all) for of_all in zip(*both, strict=True))
            for k in range(len(incidences)):
                there_below = below[same & (beside == k)]
                tested[k] = bool(np.any(there_below < 1)) and bool(np.any(there_below >= 1))
        tests.append(LobeTest(lobe, np.where(unresolved, off, 0.0), known, tested))
    return tests


def _flat_light(
    lobe: Lobe, incidences: np.ndarray, theta_i: np.ndarray, there: np.ndarray, whole: np.ndarray
) -> np.ndarray:
    """The light (incidences, C) of a lobe with a flat top, the same peak, and what was read next to it; 0 if nothing.

    Where the lobe is not seen there it may be all that is not seen. A lobe with tails, such as GGX, has a hundredth of
    this light where its foot is 12 e-folds down.
    """
    flat = np.zeros((len(incidences), max(s.f.shape[1] for s in lobe.samples)))
    for k, samples in enumerate(lobe.samples):
        f = samples.f.mean(axis=1)
        top = int(np.argmax(f))
        beside = np.flatnonzero((np.abs(theta_i - incidences[k, 0]) < SAME_LIGHT) & (there < f[top] / np.e))
        if beside.size and f[top] > 0:
            foot = beside[np.argmax(there[beside])]
            depth = np.log(f[top] / max(there[foot], VISIBLE * whole[foot], 1e-300))
            inside = (f >= there[foot]) & (f > 0)
            area = np.sum(samples.light.mean(axis=1)[inside] / f[inside])
            flat[k] = FLAT * samples.f[top] * area / np.sqrt(max(depth, 1.0))
    return flat


def _body_depth(lobe: Lobe) -> float:
    """E-folds below its peak beyond which a lobe has less than `VISIBLE` of its light, where it has the most there.

    What was read deeper tells its tail, which other families share whatever their body is.
    """
    deepest = 0.0
    for samples in lobe.samples:
        f = samples.f.mean(axis=1)
        order = np.argsort(f)
        share = np.cumsum(np.maximum(samples.light.mean(axis=1), 0.0)[order])
        if share[-1] > 0:
            edge = f[order][np.searchsorted(share, VISIBLE * share[-1])]
            deepest = max(deepest, float(np.log(f.max() / max(edge, 1e-300))))
    return min(deepest, DEEPEST)


def shape_numbers(module: Any) -> int:
    """How many numbers give a lobe, or what it is made of, its shape."""
    if not isinstance(module, eqx.Module):
        return 0
    fields = [(f, getattr(module, f.name)) for f in dataclasses.fields(module)]
    count = sum(
        f.metadata["parameter"].role in SHAPES for f, v in fields if "parameter" in f.metadata and v is not None
    )
    return count + sum(shape_numbers(v) for _, v in fields)


def _light_from(incidence: np.ndarray) -> Direction:
    theta, phi = incidence
    return Direction(*(np.asarray(c) for c in from_spherical(theta, phi, np)))


def values_at(brdf: AbstractBRDF, angles: np.ndarray) -> np.ndarray:
    """f (n, C or 1) at angles (n, 4)."""
    wi, wo = (from_spherical(angles[:, k], angles[:, k + 1], np) for k in (0, 2))
    return np.asarray(evaluate(brdf, wi, wo)).reshape(len(angles), -1)


def _below_peak(
    lobe: Lobe, incidences: np.ndarray, angles: np.ndarray, there: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """E-folds (n,) by which a lobe is below its peak at readings, and the number of the incidence nearest to each."""
    peaks = np.array([s.f.mean(axis=1).max() for s in lobe.samples])
    turned = np.abs(np.mod(angles[:, 1:2] - incidences[:, 1] + np.pi, 2 * np.pi) - np.pi)
    distance = np.abs(angles[:, :1] - incidences[:, 0]) + 1e-3 * turned
    beside = np.argmin(distance, axis=1)
    peak, other = peaks[beside], np.abs(angles[:, 0] - incidences[beside, 0]) > SAME_LIGHT
    if other.any():
        theta_i, phi_i = angles[other, 0], angles[other, 1]
        peak[other] = values_at(lobe.term, np.stack([theta_i, phi_i, theta_i, phi_i + np.pi], -1)).mean(axis=1)
    return np.clip(np.log(np.maximum(peak, there) / there), 0.0, DEEPEST), beside


class _ByLevel(NamedTuple):
    """How far a lobe is off, in e-folds, at the levels k · `STEP` below its peak.

    Attributes:
        worst: by the readings of all incidences, (levels, C).
        beside: of each group of readings of one level its incidence, (groups,); −1 − k of readings nearest to the k-th.
        level: of each group its level.
        off: of each group by itself, (groups, C).
        depths: of each group the least and the most of its e-folds below the peak, (groups, 2).
    """

    worst: np.ndarray
    beside: np.ndarray
    level: np.ndarray
    off: np.ndarray
    depths: np.ndarray


def _by_level(below: np.ndarray, beside: np.ndarray, misfit: np.ndarray) -> _ByLevel:
    """How far a lobe is off by its readings.

    Of readings of one incidence and level the rms counts; between levels the larger, and more the worse the family is.
    """
    levels, channels = int(DEEPEST / STEP) + 1, misfit.shape[1]
    groups, group = np.unique(np.stack([beside, np.floor(below / STEP)]), axis=1, return_inverse=True)
    group, level = group.ravel(), groups[1].astype(int)
    squares = np.stack([np.bincount(group, c) for c in (misfit**2).T], -1) / np.bincount(group)[:, None]
    rms = np.sqrt(squares)
    off = np.minimum(np.log1p(rms), LARGEST)
    between = np.minimum(np.log1p(rms) * (1 + rms / ANOTHER), np.log1p(FACTOR))
    worst = np.full((levels, channels), -np.inf)
    np.maximum.at(worst, level, np.maximum(off, between))
    read = np.flatnonzero(worst[:, 0] >= 0)
    every = np.arange(levels)
    before = read[np.clip(np.searchsorted(read, every, side="right") - 1, 0, None)]
    after = read[np.clip(np.searchsorted(read, every), None, read.size - 1)]
    depths = np.tile([np.inf, -np.inf], (level.size, 1))
    np.minimum.at(depths[:, 0], group, below)
    np.maximum.at(depths[:, 1], group, below)
    return _ByLevel(np.maximum(worst[before], worst[after]), groups[0].astype(int), level, off, depths)


class _Misfit(NamedTuple):
    """How far a lobe is off at an incidence, in e-folds, (levels, C), and of which levels its own readings tell."""

    off: np.ndarray
    closely: np.ndarray


def _of_incidence(number: int, of: _ByLevel) -> _Misfit:
    """How far a lobe is off at an incidence: where that was read closely it tells, and elsewhere the others do.

    Closely: at several depths within a level and those next to it. All of these count, because a residual may cross
    zero at one by luck; nothing is between them of which another family could make more.
    """
    off, these = of.worst.copy(), of.beside == number
    closely, level, depths = np.zeros(len(off), bool), of.level[these], of.depths[these]
    for k in range(len(off)):
        near = np.abs(level - k) <= 1
        around = near.any() and level[near].min() <= k <= level[near].max()
        closely[k] = around and np.ptp(depths[near]) > APART
        if closely[k]:
            off[k] = of.off[these][near].max(axis=0)
    return _Misfit(off, closely)


def _missed(samples: LobeSamples, misfit: _Misfit, nodes: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """The light (C,) that a lobe may have too much or too little.

    Of a level that was read closely nodes miss as much of the misfit as of the lobe's own light, up to twice.
    """
    top = samples.f.mean(axis=1).max()
    light = _light_by_level(samples.f, samples.light, top)
    if nodes is not None:
        f, weight = nodes
        missed = 2 * np.abs(_light_by_level(f, weight[:, None] * f, top) - light)
        light = np.where(misfit.closely[:, None], np.minimum(light, missed), light)
    return np.sum(light * np.expm1(misfit.off), axis=0)


def _light_by_level(f: np.ndarray, light: np.ndarray, top: float) -> np.ndarray:
    """Light (n, C) by the level of f (n, C) below the peak, (levels, C)."""
    size = f.mean(axis=1)
    lit = size > 0
    below = np.clip(np.log(top / np.maximum(size[lit], 1e-300)), 0.0, DEEPEST)
    level, count = np.floor(below / STEP).astype(int), int(DEEPEST / STEP) + 1
    return np.stack([np.bincount(level, c, count) for c in light[lit].T], axis=-1)
