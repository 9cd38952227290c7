"""Directional albedos of a gridded table by a control variate: the exact ones of a model that was fitted to it, and the
grid's integral of readings − model.

It assumes that between and beyond the nodes the surface is to the model as it is at the nodes around. The bound takes
the ratio of the two to be off by as much as it changes from a node to its neighbours, or bends, over the light that the
model sends there: where the model is of the wrong family that is as much as without it. Of a lobe whose shape the nodes
do not test the family is unknown, and the light with it (`untested_lobes`).
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from gonio.checks.albedos import Albedos, Incidence, albedos_of
from gonio.checks.grid_resolution import LARGEST, RESOLVED, prediction_error, prediction_error_across_pole
from gonio.checks.hidden_lobes import Features, Further, credible
from gonio.checks.table.albedos.model_light import FAST, NOISE, ORDER, albedos_at, light_of
from gonio.checks.table.albedos.on_grid import HemisphereGrid, filled, floor_of, hemisphere_grid
from gonio.checks.table.albedos.two_sided import Part
from gonio.checks.table.albedos.untested_lobes import VISIBLE, Lobe, LobeReadings, LobeTest, lobe_tests
from gonio.data.flags import Flag
from gonio.data.material import Material
from gonio.data.table import Table
from gonio.fitting.result import FitResult
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical

MOST_COVERED = 0.2  # of the light of the rest of a model, where lobes cover it, beyond which the rest is not known
BETWEEN = 0.5  # of a node's prediction error, where resolved, that the ratio may be off by between: twice the theory's


class _Shares(NamedTuple):
    """The light of a model at one incidence, (θo, azimuth, C), by the nodes nearest to it; and what of it is beyond."""

    near: np.ndarray
    beyond: np.ndarray


def _shares(brdf: AbstractBRDF, grid: HemisphereGrid, wi: Direction, channels: int) -> _Shares:
    size = grid.theta_o.size, grid.azimuth.size
    near, beyond = (np.zeros((size[0] * size[1], channels)) for _ in range(2))
    for wo, light in light_of(brdf, wi, ORDER):
        x, y, z = (np.asarray(c) for c in wo)
        up = z > 0
        theta, phi = np.arccos(np.clip(z[up], 0, 1)), np.arctan2(y[up], x[up])
        outside = (theta > grid.theta_o[-1]) | (theta < grid.theta_o[0])
        light = np.broadcast_to(light[up], (theta.size, channels))
        rows, columns = _hats(grid.theta_o, theta), _hats_around(grid.azimuth, phi)
        for (i, a), (j, b) in ((r, c) for r in rows for c in columns):
            nodes, share = i * size[1] + j, a * b
            far = nodes[outside]
            for c in range(channels):
                part = share * light[:, c]
                near[:, c] += np.bincount(nodes, part, near.shape[0])
                if far.size:
                    beyond[:, c] += np.bincount(far, part[outside], near.shape[0])
    return _Shares(*(a.reshape(*size, channels) for a in (near, beyond)))


def _hats(nodes: np.ndarray, angles: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    k = np.clip(np.searchsorted(nodes, angles) - 1, 0, nodes.size - 2)
    t = np.clip((angles - nodes[k]) / (nodes[k + 1] - nodes[k]), 0.0, 1.0)
    return [(k, 1 - t), (k + 1, t)]


def _hats_around(nodes: np.ndarray, angles: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    closed = np.append(nodes, nodes[0] + 2 * np.pi)
    return [(k % nodes.size, t) for k, t in _hats(closed, nodes[0] + np.mod(angles - nodes[0], 2 * np.pi))]


def _at_nodes(brdf: AbstractBRDF, grid: HemisphereGrid, channels: int) -> np.ndarray:
    """The model at the nodes of all incidences, (n, θo, azimuth, C)."""
    angles = np.array([(t, p) for _, t, p in grid.incidences])
    shape = len(angles), grid.theta_o.size, grid.azimuth.size
    theta_i, phi_i = (np.broadcast_to(a[:, None, None], shape) for a in angles.T)
    theta_o, phi_o = (np.broadcast_to(a, shape) for a in (grid.theta_o[:, None], grid.azimuth))
    wi, wo = from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
    f = np.asarray(evaluate(brdf, wi, wo))
    return np.broadcast_to(f.reshape(*shape, -1), (*shape, channels))


def _terms(brdf: AbstractBRDF) -> tuple[AbstractBRDF, ...]:
    """Those of a model; itself where it is dark between these sides."""
    return brdf.terms() or (brdf,)


def _difference(term: AbstractBRDF, grid: HemisphereGrid, channels: int) -> np.ndarray:
    """What the grid misses of the albedos of a term at all incidences, (n, C)."""
    by_grid = np.sum(grid.weights * _at_nodes(term, grid, channels), axis=(1, 2))
    return albedos_at(term, _lights(grid), FAST, channels) - by_grid


def _lights(grid: HemisphereGrid) -> Direction:
    """Directions (n,) of the light of all incidences."""
    theta, phi = np.array([(t, p) for _, t, p in grid.incidences]).T
    return from_spherical(theta, phi, np)


def assisted_albedos(part: Part, fitted: FitResult, features: Features) -> Albedos | str:
    """Albedos at every incidence of a spherical or isotropic table, with the help of a model fitted to it.

    Args:
        part: the readings of one pair of sides of the table.
        fitted: the fit of a model to all of it.
        features: what a lobe that hides at the mirror direction is like.

    Returns:
        The albedos with their bounds, or why there are none.
    """
    table = part.table
    grid = hemisphere_grid(table.layout)
    if isinstance(grid, str):
        return grid
    if not fitted.converged:
        return "the fit of the model did not converge"
    brdf = part.folded(fitted.brdf)
    if features.further is not None:
        features = features._replace(further=_left_of(features.further, brdf))
    method = (
        f"Model-assisted: the albedo of {fitted.requested}, fitted to the table, and the grid's integral of readings − "
        "model; between the nodes the surface is taken to follow the model as it does at the nodes around."
    )
    return albedos_of(_incidences(part, grid, brdf, fitted, features), method, features)


def _incidences(
    part: Part, grid: HemisphereGrid, brdf: AbstractBRDF, fitted: FitResult, features: Features
) -> Iterator[Incidence]:
    table, channels = part.table, len(part.table.channels)
    terms = [_at_nodes(term, grid, channels) for term in _terms(brdf)]
    at_nodes, exact = np.sum(terms, axis=0), albedos_at(brdf, _lights(grid), FAST, channels)
    tests = _lobe_tests(table, grid, brdf, terms, features.further)
    whole = _Sides(grid, terms, np.ones((len(terms), len(exact)), bool), tests)
    both = [whole, whole.beside_lobes()]
    weights = np.stack([side.carried for side in both]).astype(float)

    known = [_difference(term, grid, channels) for term in _terms(brdf)]

    def missed(material: Material) -> np.ndarray:
        both = zip(_terms(part.folded(material.brdf)), _terms(brdf), known, strict=True)
        each = [k if eqx.tree_equal(t, base) else _difference(t, grid, channels) for t, base, k in both]
        return np.einsum("stn,tnc->snc", weights, each)

    spreads = 2.0 * np.nan_to_num(fitted.propagated(missed, by_channel=True), nan=np.inf)
    for k, (number, theta_i, phi_i) in enumerate(grid.incidences):
        block = table.read_values(number * grid.stored, (number + 1) * grid.stored)
        f, u, valid = (block[name][grid.cells] for name in ("f", "u_f", "flag"))
        valid = valid == Flag.VALID
        wi = Direction(*(jnp.asarray(c) for c in from_spherical(theta_i, phi_i, np)))
        each = [_shares(term, grid, wi, channels) for term in _terms(brdf)]
        readings = f.astype(float), u.astype(float), valid
        rows = [side.estimate(k, readings, each) for side in both[: 1 + bool(np.any(~both[1].carried[:, k]))]]
        row = _least(row._replace(bound=row.bound + s[k]) for row, s in zip(rows, spreads, strict=False))
        error = np.abs(np.sum([s.near for s in each], axis=(0, 1, 2)) - exact[k])
        bound = row.bound + 2.0 * error
        partial = grid.missing(valid)
        limit = np.where(valid, credible(_left_to_lobes(f, u, at_nodes[k]), row.value), np.inf)
        hidden = None if partial else grid.hidden((theta_i, phi_i), limit, features, part.bend)
        yield row._replace(theta_i=theta_i, phi_i=phi_i, bound=bound, partial=partial, hidden=hidden)


def _least(rows: Iterator[Incidence]) -> Incidence:
    """Of each channel the estimate with the smallest bound."""
    best = next(rows)
    for row in rows:
        pairs = ((getattr(best, name), getattr(row, name)) for name in ("value", "bound", "noise"))
        value, bound, noise = (np.where(row.bound < best.bound, b, a) for a, b in pairs)
        best = best._replace(value=value, bound=bound, noise=noise)
    return best


class _Sides(NamedTuple):
    """A way to the albedos: of which terms of the model the light is carried by the nodes, and of which it is taken.

    Attributes:
        terms: the model's at the nodes, (n, θo, azimuth, C) each.
        carried: whether the nodes carry the light of each term at each incidence, (terms, n). That of the other terms
            is known by what was read on them, whatever the nodes tell.
        tests: of lobes.
    """

    grid: HemisphereGrid
    terms: list[np.ndarray]
    carried: np.ndarray
    tests: list[LobeTest]

    def beside_lobes(self) -> "_Sides":
        """That where the nodes carry no lobe that is tested."""
        carried = self.carried.copy()
        for test in self.tests:
            carried[test.lobe.number] &= ~test.tested
        return self._replace(carried=carried)

    def estimate(self, k: int, readings: tuple[np.ndarray, np.ndarray, np.ndarray], shares: list[_Shares]) -> Incidence:
        """The albedo of one incidence, of its readings (f, u, valid) and the light of each term."""
        carried, (f, u, valid) = self.carried[:, k], readings
        at_nodes, none = np.stack([m[k] for m in self.terms]), np.zeros_like(self.terms[0][k])
        others, lobes = np.sum(at_nodes[carried], axis=0), np.sum(at_nodes[~carried], axis=0)
        # Nodes are compared with what else the model sends where the lobes are dark; on them they follow those around.
        beside = valid & (lobes <= VISIBLE * others)
        ratio = np.where(beside, (f - lobes) / np.maximum(others, np.finfo(float).tiny), 0.0)
        f = np.where(beside | ~valid, f - lobes, filled(ratio, beside) * others)
        light = _sum_of([_Shares(none, none), *(s for s, c in zip(shares, carried, strict=True) if c)])
        row = _estimate(self.grid, (f, np.where(beside, u, 0.0), valid), others, light)
        of_lobes = sum((s.near.sum(axis=(0, 1)) for s, c in zip(shares, carried, strict=True) if not c), 0.0)
        off = sum(t.off[k] if carried[t.lobe.number] else t.by_readings[k] for t in self.tests)
        guessed = 0.0 if carried.all() else _guessed(light.near, ratio, beside, valid, others)
        return row._replace(value=row.value + of_lobes, bound=row.bound + off + guessed)


def _guessed(
    light: np.ndarray, ratio: np.ndarray, beside: np.ndarray, valid: np.ndarray, model: np.ndarray
) -> np.ndarray:
    """What of the light (C,) of some nodes that the lobes cover is guessed: it follows the ratio of the others.

    That is as sure as the ratio is even among these; where they are few nothing is.
    """
    total = light.sum(axis=(0, 1))
    covered = np.sum(np.where(valid & ~beside, light, 0.0), axis=(0, 1))
    counts = beside & (model > floor_of(total))
    high = np.max(np.where(counts, ratio, -np.inf), axis=(0, 1))
    low = np.min(np.where(counts, ratio, np.inf), axis=(0, 1))
    sure = (covered <= MOST_COVERED * total) & (low > 0) & np.isfinite(low)
    uneven = np.where(sure, high, 1.0) / np.where(sure, low, 1.0) - 1
    return np.where(sure, covered * uneven, np.where(total > 0, np.inf, 0.0))


def _sum_of(shares: list[_Shares]) -> _Shares:
    return _Shares(*(np.sum(parts, axis=0) for parts in zip(*shares, strict=True)))


def _lobe_tests(
    table: Table, grid: HemisphereGrid, brdf: AbstractBRDF, terms: list[np.ndarray], further: Further | None
) -> list[LobeTest]:
    """Of the lobes of a model, with their values at the nodes, (n, θo, azimuth, C), what the readings tell of them."""
    incidences = np.array([(t, p) for _, t, p in grid.incidences])
    shape = terms[0].shape[:3]
    axes = (*(a[:, None, None] for a in incidences.T), grid.theta_o[:, None], grid.azimuth)
    nodes = np.stack([np.broadcast_to(a, shape) for a in axes], axis=-1).reshape(-1, 4)
    blocks = [table.read_values(n * grid.stored, (n + 1) * grid.stored) for n, _, _ in grid.incidences]
    f, u, flag = (np.stack([b[name][grid.cells] for b in blocks]).reshape(len(nodes), -1) for name in blocks[0])
    use = (flag == Flag.VALID).all(axis=1)
    readings = LobeReadings(nodes[use], f[use].astype(float), np.nan_to_num(u[use].astype(float))).thinned
    if further is not None:
        readings = readings.joined(LobeReadings(further.angles, further.f, further.u))

    def resolved(lobe: Lobe) -> np.ndarray:
        pairs = zip(terms[lobe.number], lobe.light(f.shape[1]), strict=True)
        return np.stack([grid.resolves(*pair) for pair in pairs])

    def at_nodes(lobe: Lobe, k: int) -> tuple[np.ndarray, np.ndarray]:
        weight = np.broadcast_to(grid.weights, (*shape[1:], 1))
        return terms[lobe.number][k].reshape(-1, f.shape[1]), weight.ravel()

    return lobe_tests(brdf, incidences, readings, resolved, at_nodes)


def _left_of(further: Further, brdf: AbstractBRDF) -> Further:
    """Further readings with the limits of what the model has not."""
    wi, wo = (from_spherical(further.angles[:, k], further.angles[:, k + 1], np) for k in (0, 2))
    model = np.broadcast_to(np.asarray(evaluate(brdf, wi, wo)).reshape(len(further.f), -1), further.f.shape)
    limit = _left_to_lobes(further.f[:, None], further.u[:, None], np.array(model)[:, None])[:, 0]
    return further._replace(limit=np.minimum(limit, further.limit))


def _left_to_lobes(f: np.ndarray, u: np.ndarray, model: np.ndarray) -> np.ndarray:
    """What a lobe may be at the nodes that the model has not, 1/sr: the residual, and twice the scatter about it."""
    scale = np.maximum(model, floor_of(np.max(model, axis=(0, 1))))
    scatter = np.sqrt(np.mean(((f - model) / scale) ** 2, axis=(0, 1)))
    u = np.nan_to_num(u)
    return np.minimum(np.abs(f - model) + 2 * np.maximum(u, scatter * scale), np.maximum(f, 0.0) + 2 * u)


class _Nodes(NamedTuple):
    """Readings and model at the nodes of one incidence, (θo, azimuth, C); below `floor` (C,) nothing matters."""

    f: np.ndarray
    u: np.ndarray
    model: np.ndarray
    floor: np.ndarray
    added: np.ndarray
    """Light, 1/sr, in the model that makes it no darker than the floor."""

    @property
    def ratio(self) -> np.ndarray:
        """Logarithm of readings over model."""
        return np.log(np.maximum(self.f, self.floor)) - np.log(np.maximum(self.model, self.floor))

    @property
    def noise(self) -> np.ndarray:
        """How far noise alone may move that logarithm."""
        return NOISE * self.u / np.maximum(np.abs(self.f), self.floor)


class _Sum(NamedTuple):
    """An albedo (C,), what the grid may have missed of it, and the standard uncertainty that the readings make."""

    value: np.ndarray
    missed: np.ndarray
    noise: np.ndarray


def _estimate(
    grid: HemisphereGrid, readings: tuple[np.ndarray, np.ndarray, np.ndarray], m: np.ndarray, shares: _Shares
) -> Incidence:
    """The albedo of one incidence, of readings (f, u, valid) and the model m at the nodes, (θo, azimuth, C) each.

    The light of the model and the integral of the difference, which suits noise and what the model has not; or that
    light, node by node, times the ratio, which suits a model whose amount or shape is a little off. Of each channel the
    one with the smaller bound.
    """
    f, u, valid = readings
    weight, whole = grid.weights, filled(np.where(valid, f, 0.0), valid)
    floor = floor_of(np.sum(shares.near + weight * (whole - m), axis=(0, 1)))
    # Where the model is dark the ratio to it tells nothing: light up to the floor is added to both.
    added = np.maximum(floor - m, 0.0)
    shares, m = shares._replace(near=shares.near + weight * added), m + added
    nodes = _Nodes(whole, np.where(valid & np.isfinite(u), u, 0.0), m, floor, added)
    sums = _of_the_difference(grid, nodes, shares), _of_the_ratio(grid, nodes, shares)
    bounds = [s.missed + 2 * s.noise for s in sums]
    pairs = zip(*((s.value, bound, s.noise) for s, bound in zip(sums, bounds, strict=True)), strict=True)
    value, bound, noise = (np.where(bounds[1] < bounds[0], b, a) for a, b in pairs)
    rest = np.sum(weight * np.where(valid, 0.0, np.abs(whole)), axis=(0, 1))
    # Of nodes that are dark by the model and by the readings no more is known than that.
    rest += np.sum(np.where((added > 0) & (whole < floor), weight * floor, 0.0), axis=(0, 1))
    return Incidence(np.nan, np.nan, value, bound + rest, noise)


def _of_the_difference(grid: HemisphereGrid, nodes: _Nodes, shares: _Shares) -> _Sum:
    weight, m = grid.weights, nodes.model
    change = _change(nodes)
    missed = np.sum((shares.near - shares.beyond) * np.expm1(np.minimum(change, LARGEST)), axis=(0, 1))
    missed += _beyond(grid, shares, change)
    # What the model leaves by a factor that is even everywhere, times what the grid misses of the model.
    off = np.maximum(np.abs(nodes.f - m) - NOISE * nodes.u, 0.0) / np.maximum(m, nodes.floor)
    missed += np.sum(np.minimum(off, np.expm1(LARGEST)) * np.abs(shares.near - weight * m), axis=(0, 1))
    return _Sum(np.sum(shares.near + weight * (nodes.f - m), axis=(0, 1)), missed, _rms(weight * nodes.u))


def _of_the_ratio(grid: HemisphereGrid, nodes: _Nodes, shares: _Shares) -> _Sum:
    light = shares.near / np.maximum(nodes.model, nodes.floor)
    errors = (
        prediction_error_across_pole(nodes.ratio, grid.theta_o, grid.azimuth),
        prediction_error(nodes.ratio, grid.azimuth, 1, 2 * np.pi),
    )
    bent = np.minimum(np.maximum(errors[0] - nodes.noise, 0.0) + np.maximum(errors[1] - nodes.noise, 0.0), LARGEST)
    bent = np.where(bent <= RESOLVED, BETWEEN, 1.0) * np.expm1(bent)
    growth = np.maximum(np.abs(nodes.f), nodes.floor) / np.maximum(nodes.model, nodes.floor)
    missed = np.sum((shares.near - shares.beyond) * growth * bent, axis=(0, 1))
    outside = _Shares(shares.near, shares.beyond * growth)
    missed += _beyond(grid, outside, _change(nodes))
    value = np.sum(light * (nodes.f + nodes.added) - grid.weights * nodes.added, axis=(0, 1))
    return _Sum(value, missed, _rms(light * nodes.u))


def _beyond(grid: HemisphereGrid, shares: _Shares, change: np.ndarray) -> np.ndarray:
    """Beyond the outermost nodes the ratio may go on changing, as far as the gap is wide."""
    gaps = np.array([grid.theta_o[0], np.pi / 2 - grid.theta_o[-1]]) / np.median(np.diff(grid.theta_o))
    further = np.ones((grid.theta_o.size, 1, 1))
    further[[0, -1], 0, 0] = np.maximum(gaps, 1.0)
    return np.sum(shares.beyond * np.expm1(np.minimum(change * further, LARGEST)), axis=(0, 1))


def _rms(a: np.ndarray) -> np.ndarray:
    return np.sqrt(np.sum(a**2, axis=(0, 1)))


def _change(nodes: _Nodes) -> np.ndarray:
    """The largest |difference| of the ratio to its neighbours along both axes, beyond that of their noise."""
    return _change_along(nodes, 0) + _change_along(nodes, 1)


def _change_along(nodes: _Nodes, axis: int) -> np.ndarray:
    before, theirs = (np.roll(a, 1, axis) for a in (nodes.ratio, nodes.noise))
    step = np.maximum(np.abs(nodes.ratio - before) - np.hypot(nodes.noise, theirs), 0.0)
    if axis == 0:  # the azimuths close on themselves, the polar angles do not
        step[0] = 0.0
    return np.maximum(step, np.roll(step, -1, axis))
