"""Directional albedos of scattered and half/difference tables by a control variate, as `model_assisted` without a grid.

The light of the fitted model is followed into the hemisphere. Where it goes the surface is taken to be to the model as
at the nearest reading, and the bound takes that ratio to be off by as much as it changes to the readings around. A
little light is added everywhere to both, so that the ratio is defined where the model is dark. Of a lobe whose shape no
reading tests the family is unknown, and the light with it (`untested_lobes`).
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from gonio.checks.albedos import Albedos, Incidence, albedos_of
from gonio.checks.grid_resolution import LARGEST
from gonio.checks.hidden_lobes import Features, NearMirror, credible, hidden_energy
from gonio.checks.table.albedos.model_light import FAST, NOISE, ORDER, albedos_at, light_of
from gonio.checks.table.albedos.on_grid import FLOOR, MOST_MISSING
from gonio.checks.table.albedos.ratio_fields import HalfVectorField, NearestField, half_vector_field, nearest_field
from gonio.checks.table.albedos.two_sided import Part
from gonio.checks.table.albedos.untested_lobes import Lobe, LobeReadings, lobe_tests, values_at
from gonio.data.material import Material
from gonio.fitting.result import FitResult
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy

POINTS = 4096
"""Directions of the hemisphere, even in projected solid angle, of the light that is added everywhere."""

WINDOW, PARTS = 12, 50
"""Readings of like half vectors that show a misfit: so many at the least, and a part of all."""

LITTLE = 1e-12
"""Weight, sr, of readings that count in an albedo, of which no more is taken for granted."""

CARRIED = 0.5
"""Of a lobe's light, that the nearest readings of a lobe that they resolve may move elsewhere."""

SAME_TILT = np.radians(10.0)
"""Readings whose angle of difference is so near to an incidence limit the lobes that may hide there."""


class _Readings(NamedTuple):
    """Where the readings are, and of each (n, C): f, its uncertainty, the model; and the light that is added (C,)."""

    field: NearestField | HalfVectorField
    model: np.ndarray
    added: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        """Readings over model, the added light included."""
        return (self.field.f + self.added) / (self.model + self.added)

    def misfit(self, theta_h: np.ndarray) -> np.ndarray:
        """How far the ratio is from 1, in e-folds, at the readings of about such half vectors, (m, C), noise apart.

        A lobe that the model has not, or has too wide, is one of the half vector at every incidence, and is seen
        where readings happen to be near it.
        """
        of_readings = self.field.half_vectors[0]
        order = np.argsort(of_readings, kind="stable")
        window = min(max(WINDOW, order.size // PARTS), order.size)
        more, allowed = (
            np.cumsum(np.concatenate([np.zeros((1, self.added.size)), a[order]]), axis=0)
            for a in (np.log(np.maximum(self.ratio, 1e-12)) ** 2, (self.noise / NOISE) ** 2)
        )
        first = np.clip(np.searchsorted(of_readings[order], theta_h) - window // 2, 0, order.size - window)
        total, by_noise = (a[first + window] - a[first] for a in (more, allowed))
        return 2 * np.sqrt(np.maximum(total - (1 + 2 * np.sqrt(2 / window)) * by_noise, 0.0) / window)

    @property
    def noise(self) -> np.ndarray:
        """How far noise alone may move the logarithm of the ratio."""
        return NOISE * self.field.u / np.maximum(np.abs(self.field.f) + self.added, self.added)


class _Light(NamedTuple):
    """The light of one incidence by readings: their numbers (n,), their weights in the albedo (n, C), and the rest."""

    numbers: np.ndarray
    weight: np.ndarray
    row: Incidence


def assisted_by_nearest(part: Part, fitted: FitResult, features: Features) -> Albedos | str:
    """Albedos of a scattered or half/difference table, with the help of a model fitted to it; or why there are none.

    Args:
        part: the readings of one pair of sides of a table. Incidences with enough of them are judged; if none has,
            0, 10, ... 80°.
        fitted: the fit of a model to all of it.
        features: what a lobe that hides at the mirror direction is like.
    """
    table, brdf = part.table, part.folded(fitted.brdf)
    field = half_vector_field(table) if table.layout.in_half_vectors else nearest_field(table)
    if isinstance(field, str):
        return field
    if not fitted.converged:
        return "the fit of the model did not converge"
    channels = len(table.channels)
    incidences = field.incidences()
    if not incidences:
        return "no incidence was read"
    model = _model(brdf, field.angles, channels)
    most = np.max(albedos_at(brdf, _lights_from(incidences), FAST, channels), axis=0)
    readings = _Readings(field, model, np.maximum(FLOOR * most / np.pi, 1e-300))
    lights = list(_lights(brdf, readings, incidences))
    used = np.unique(np.concatenate([light.numbers for light in lights]))

    def missed(material: Material) -> np.ndarray:
        """What the readings would miss of a material's albedos, (incidences, C)."""
        surface = part.folded(material.brdf)
        m = _model(surface, field.angles[used], channels)
        known = [np.sum(light.weight * m[np.searchsorted(used, light.numbers)], axis=0) for light in lights]
        return albedos_at(surface, _lights_from(incidences), FAST, channels) - known

    spread = 2.0 * np.nan_to_num(fitted.propagated(missed, by_channel=True), nan=np.inf)
    limit = credible(_left_to_lobes(readings), most)
    untested = _untested(brdf, field, incidences, channels)
    rows = [
        light.row._replace(bound=light.row.bound + s + t, hidden=_hidden(field, i, limit, features))
        for light, s, t, i in zip(lights, spread, untested, incidences, strict=True)
    ]
    method = (
        f"Model-assisted: the light of {fitted.requested}, fitted to the table, times the ratio of the readings to it; "
        "between the readings the surface is taken to follow the model as it does at them."
    )
    return albedos_of(rows, method, features)


def _light_from(incidence: tuple[float, float]) -> Direction:
    return Direction(*(jnp.asarray(c) for c in from_spherical(*incidence, np)))


def _lights_from(incidences: Sequence[tuple[float, float]]) -> Direction:
    """Directions (n,) of the light."""
    theta, phi = np.array(incidences, float).reshape(-1, 2).T
    return from_spherical(theta, phi, np)


def _model(brdf: AbstractBRDF, angles: np.ndarray, channels: int) -> np.ndarray:
    wi, wo = from_spherical(angles[:, 0], angles[:, 1], np), from_spherical(angles[:, 2], angles[:, 3], np)
    return np.broadcast_to(np.asarray(evaluate(brdf, wi, wo)).reshape(len(angles), -1), (len(angles), channels))


def _lights(brdf: AbstractBRDF, readings: _Readings, incidences: list[tuple[float, float]]) -> Iterator[_Light]:
    change = readings.field.change(np.log(np.maximum(readings.ratio, 1e-12)), readings.noise)
    for incidence in incidences:
        wo, light, added = _directions(brdf, incidence, readings.added)
        theta_o, phi_o = np.arccos(np.clip(wo.z, 0, 1)), np.arctan2(wo.y, wo.x)
        number, stretch, gap = readings.field.nearest(incidence, theta_o, phi_o)
        off = np.maximum(change[number] * stretch[:, None], readings.misfit(_tilt(incidence, wo)))
        carried = light * np.abs(readings.ratio)[number]
        missed = carried * np.maximum(np.expm1(np.minimum(off, LARGEST)), gap[:, None])
        numbers, place = np.unique(number, return_inverse=True)
        sums = np.stack([np.bincount(place, c, numbers.size) for c in light.T], -1)
        weight = sums / (readings.model + readings.added)[numbers]
        f, u = readings.field.f[numbers], readings.field.u[numbers]
        value = np.sum(weight * (f + readings.added), axis=0) - np.sum(light[added], axis=0)
        noise = np.sqrt(np.sum((weight * u) ** 2, axis=0))
        exact = albedos_at(brdf, _lights_from([incidence]), FAST, readings.added.size)[0]
        error = 2 * np.abs(np.sum(light[~added], axis=0) - exact)
        partial = bool(gap[added].mean() > MOST_MISSING)
        bound = missed.sum(axis=0) + error + 2 * noise
        yield _Light(numbers, weight, Incidence(*incidence, value, bound, noise, partial=partial))


def _untested(
    brdf: AbstractBRDF, field: NearestField | HalfVectorField, incidences: list[tuple[float, float]], channels: int
) -> np.ndarray:
    """What the albedos of a model may be off by because of lobes that no reading tests, (incidences, C)."""

    def resolved(lobe: Lobe) -> np.ndarray:
        at_readings, shares = values_at(lobe.term, field.angles).mean(axis=1), []
        for incidence, (wo, light, f) in zip(incidences, lobe.samples, strict=True):
            lit = light.sum(axis=1) > 0
            theta_o, phi_o = np.arccos(np.clip(wo.z[lit], 0, 1)), np.arctan2(wo.y[lit], wo.x[lit])
            number, _, gap = field.nearest(incidence, theta_o, phi_o)
            off = np.minimum(np.abs(at_readings[number] / f[lit].mean(axis=1) - 1), 1.0)
            of_light = np.sum(light[lit] * np.where(gap, 1.0, off)[:, None], axis=0)
            shares.append(np.broadcast_to(of_light <= CARRIED * light.sum(axis=0), channels))
        return np.stack(shares)

    readings = LobeReadings(field.angles, field.f, field.u).thinned
    tests = lobe_tests(brdf, np.array(incidences), readings, resolved)
    return sum((t.off for t in tests), np.zeros((len(incidences), channels)))


def _directions(
    brdf: AbstractBRDF, incidence: tuple[float, float], added: np.ndarray
) -> tuple[Direction, np.ndarray, np.ndarray]:
    """Where the model's light goes above the horizon, how much (n, C) of it, and which (n,) is what is added to it."""
    point = low_discrepancy(POINTS, 2)
    even = from_spherical(np.arcsin(np.sqrt(point[:, 0])), 2 * np.pi * point[:, 1], np)
    parts = [*light_of(brdf, _light_from(incidence), ORDER), (Direction(*even), np.pi / POINTS * added[None])]
    wo = Direction(*(np.concatenate([np.asarray(d[k]) for d, _ in parts]) for k in range(3)))
    light = np.concatenate([np.broadcast_to(a, (len(d.x), added.size)) for d, a in parts])
    up = wo.z > 0
    return Direction(*(c[up] for c in wo)), light[up], (np.arange(len(light)) >= len(light) - POINTS)[up]


def _tilt(incidence: tuple[float, float], wo: Direction) -> np.ndarray:
    x, y, z = (a + b for a, b in zip(from_spherical(*incidence, np), wo, strict=True))
    return np.arctan2(np.hypot(x, y), z)


def _left_to_lobes(readings: _Readings) -> np.ndarray:
    """What a lobe may be at the readings that the model has not, 1/sr: the residual, and twice the scatter about it."""
    field, scale = readings.field, readings.model + readings.added
    scatter = np.sqrt(np.mean(((field.f - readings.model) / scale) ** 2, axis=0))
    limit = np.abs(field.f - readings.model) + 2 * np.maximum(field.u, scatter * scale)
    return np.minimum(limit, np.maximum(field.f, 0.0) + 2 * field.u)


def _hidden(
    field: NearestField | HalfVectorField, incidence: tuple[float, float], limit: np.ndarray, features: Features
) -> np.ndarray | None:
    """What a lobe may hide at an incidence: its tails are those of all readings of about the same difference angle."""
    theta_h, phi_h, theta_d, cosines = field.half_vectors
    near = np.flatnonzero(np.abs(theta_d - incidence[0]) < SAME_TILT)
    near = near[np.argsort(theta_h[near], kind="stable")[: 4 * 48]]
    if near.size and 2 * theta_h[near[0]] <= features.reach:
        return None
    cosines = np.maximum(cosines[near], np.cos(incidence[0]) ** 2)
    nodes = NearMirror(theta_h[near], phi_h[near], cosines, np.full(near.size, LITTLE), near)
    return hidden_energy(nodes, limit[near], field.isotropic)
