"""Directional albedos of tables on a grid of polar angles and azimuths (spherical, isotropic), with their bounds.

∫ f cosθ dω by product rules exact for what is linear between the nodes. The bound is the sum of what the grid may have
missed between its nodes (`grid_resolution`), of the cap and the rim beyond its outermost nodes, of the cells
without a reading, and of the noise.
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos, Incidence, albedos_of
from gonio.checks.grid_resolution import (
    LARGEST,
    RESOLVED,
    excess,
    hemisphere_weights,
    log_values,
    periodic_weights,
    prediction_error,
    prediction_error_across_pole,
    with_rim,
)
from gonio.checks.hidden_lobes import REFLECTED, Features, NearMirror, credible, hidden_energy, refracted
from gonio.data.angles import SLACK
from gonio.data.flags import Flag
from gonio.data.layouts import Layout
from gonio.data.table import Table

FLOOR = 1e-3
"""Below this share of the mean of f cosθ it does not matter whether the grid resolves f; it counts as bound."""

WIDEST_GAP, WIDEST_CAP, LEAST_RIM = np.radians([46.0, 30.0, 60.0])
"""Largest step in azimuth, largest polar angle of the first ring, smallest of the last."""

UNRESOLVED, COARSELY = 0.1, 0.3
"""Of a lobe's light, that all nodes and every second one may miss of a lobe that they resolve."""

MOST_MISSING = 0.2
"""Share of the hemisphere's projected solid angle without readings beyond which there is no albedo."""


def floor_of(albedo: np.ndarray) -> np.ndarray:
    """f, 1/sr, below which nothing matters to so large an albedo."""
    return np.maximum(FLOOR * np.abs(albedo) / np.pi, 1e-300)


class _Half(NamedTuple):
    """Some rings and azimuths of a grid, and the projected solid angles of their nodes, sr."""

    rings: np.ndarray
    sides: np.ndarray
    weights: np.ndarray

    def integral(self, f: np.ndarray) -> np.ndarray:
        """Of f (theta, azimuth, C) by these nodes alone."""
        return np.sum(self.weights * f[self.rings][:, self.sides], axis=(0, 1))


@dataclasses.dataclass(frozen=True)
class HemisphereGrid:
    """The directions of every incidence, once around the normal, with the cells that hold them."""

    theta_o: np.ndarray
    azimuth: np.ndarray
    cells: np.ndarray
    """(theta_o, azimuth): number of the cell among the `stored` ones of an incidence."""
    stored: int
    incidences: list[tuple[int, float, float]]
    """(number, theta_i, phi_i) of those above the horizon, radians."""
    mirrored: bool
    isotropic: bool

    @functools.cached_property
    def weights(self) -> np.ndarray:
        """Projected solid angle of each direction, sr, (theta_o, azimuth, 1): exact for what is linear between."""
        return hemisphere_weights(self.theta_o, self.azimuth)

    @functools.cached_property
    def halves(self) -> "list[_Half]":
        """Every second ring and azimuth, in four ways; the outermost rings stay: only the resolution differs."""
        halves, count = [], self.azimuth.size
        for row, column in np.ndindex(2, 2):
            rings = np.arange(row, self.theta_o.size, 2)
            rings = np.unique(np.concatenate([[0], rings, [self.theta_o.size - 1]]))
            sides = np.arange(column, count, 2) if count >= 8 else np.arange(count)
            halves.append(_Half(rings, sides, hemisphere_weights(self.theta_o[rings], self.azimuth[sides])))
        return halves

    def distance_to_mirror(self, theta_i: float, phi_i: float, bend: float = 1.0) -> float:
        """How near the directions come to the mirror direction of an incidence, radians.

        `bend`: or to where light is refracted to, sin θ = bend · sin θi; at most to the horizon.
        """
        turn, theta_o = np.cos(self.azimuth - phi_i - np.pi), self.theta_o[:, None]
        sin = min(bend * np.sin(theta_i), 1.0)
        cos = np.cos(theta_o) * (np.cos(theta_i) if bend == 1.0 else np.sqrt(1 - sin**2)) + np.sin(theta_o) * sin * turn
        return float(np.arccos(np.clip(cos.max(), -1, 1)))

    def hidden(
        self, incidence: tuple[float, float], limit: np.ndarray, features: Features, bend: float = 1.0
    ) -> np.ndarray | None:
        """What a lobe may hide of an incidence (theta_i, phi_i), as `hidden_energy` says; None where it would be seen.

        `limit` (theta_o, azimuth, channels), 1/sr: what the lobe may be at each node at the most.
        """
        distance = self.distance_to_mirror(*incidence, bend)
        if distance <= features.reach:
            return None
        shape = limit.shape[:2]
        theta_o, phi_o = (np.broadcast_to(a, shape).ravel() for a in (self.theta_o[:, None], self.azimuth))
        nodes = NearMirror.of(incidence, theta_o, phi_o, self.weights.ravel(), bend)
        limit = limit.reshape(-1, limit.shape[2])[nodes.number]
        if features.further is not None:
            beside, theirs = features.further.near(incidence, self.isotropic, bend)
            nodes, limit = nodes.joined(beside), np.concatenate([limit, theirs])
        lobes = REFLECTED if bend == 1.0 else refracted(incidence[0], bend)
        return hidden_energy(nodes, limit, self.isotropic, lobes)

    def resolves(self, f: np.ndarray, albedo: np.ndarray) -> np.ndarray:
        """Whether it integrates f (theta_o, azimuth, C) of an albedo (C,): itself, and every second node of it too.

        One node may by chance have the light of a lobe that it does not resolve.
        """
        off = np.abs(np.sum(self.weights * f, axis=(0, 1)) - albedo)
        coarse = np.max([np.abs(half.integral(f) - albedo) for half in self.halves], axis=0)
        return (off <= UNRESOLVED * albedo) & (coarse <= COARSELY * albedo)

    def missing(self, valid: np.ndarray) -> bool:
        """Whether too much of the hemisphere has no reading; `valid` (theta_o, azimuth, channels)."""
        return bool(np.max(np.sum(self.weights * ~valid, axis=(0, 1))) > MOST_MISSING * np.pi)


def hemisphere_grid(layout: Layout) -> HemisphereGrid | str:
    """The directions of a layout that are the same for every incidence, or why they do not cover the hemisphere."""
    grid = layout.outgoing_grid()
    if grid is None:
        return "its directions differ from incidence to incidence"
    mirrored = bool(layout.mirrored_axes)
    rows = np.flatnonzero(grid.theta_o < np.pi / 2 - 1e-9)
    azimuth, source = _once_around(grid.azimuth, mirrored)
    theta_o = grid.theta_o[rows]
    if theta_o.size < 3 or theta_o[-1] < LEAST_RIM - SLACK or np.ptp(azimuth) == 0:
        return "its directions do not cover the hemisphere"
    gap = np.diff(np.append(azimuth, azimuth[0] + 2 * np.pi)).max()
    if gap > WIDEST_GAP + SLACK or theta_o[0] > WIDEST_CAP + SLACK:
        return "its directions leave a gap in the hemisphere"
    every = enumerate(itertools.product(grid.theta_i, grid.phi_i))
    incidences = [(k, t, p) for k, (t, p) in every if t < np.pi / 2 - 1e-9]
    cells, stored = rows[:, None] * grid.azimuth.size + source, grid.theta_o.size * grid.azimuth.size
    return HemisphereGrid(theta_o, azimuth, cells, stored, incidences, mirrored, not layout.has_azimuth_of_light)


def grid_albedos(table: Table, features: Features, bend: float = 1.0) -> Albedos | str:
    """Albedos at every incidence of a spherical or isotropic table.

    `features`: what a lobe that hides at the mirror direction is like; `bend` as of
    `HemisphereGrid.distance_to_mirror`.
    """
    grid = hemisphere_grid(table.layout)
    if isinstance(grid, str):
        return grid
    return albedos_on(grid, incidences_on(grid, table, features, bend), features)


def incidences_on(
    grid: HemisphereGrid, table: Table, features: Features, bend: float = 1.0, some: slice = slice(None)
) -> list[Incidence]:
    """Each incidence of a grid by itself, or of some of `HemisphereGrid.incidences`; as of `grid_albedos`."""
    rows = []
    for number, theta_i, phi_i in grid.incidences[some]:
        block = table.read_values(number * grid.stored, (number + 1) * grid.stored)
        f, u, valid = (block[name][grid.cells] for name in ("f", "u_f", "flag"))
        valid = valid == Flag.VALID
        estimate = _estimate(grid, f.astype(float), u.astype(float), valid, bend != 1.0)
        estimate = estimate._replace(theta_i=theta_i, phi_i=phi_i)
        if grid.missing(valid):
            read = np.sum(grid.weights * np.where(valid, f.astype(float), 0.0), axis=(0, 1))
            rows.append(estimate._replace(value=read, partial=True))
        else:
            limit = np.where(valid, credible(np.maximum(f, 0.0) + 2 * np.nan_to_num(u), estimate.value), np.inf)
            rows.append(estimate._replace(hidden=grid.hidden((theta_i, phi_i), limit, features, bend)))
    return rows


def albedos_on(grid: HemisphereGrid, rows: Iterable[Incidence], features: Features) -> Albedos | str:
    """The albedos of every incidence of a grid, in its order."""
    method = "Integrated on the table's own grid"
    if grid.mirrored:
        method += ", taking the surface as mirror symmetric, as azimuth differences stop at 180°"
    return albedos_of(rows, method + ".", features)


def _estimate(grid: HemisphereGrid, f: np.ndarray, u: np.ndarray, valid: np.ndarray, refracted: bool) -> Incidence:
    """The albedo of one incidence, of readings of shape (theta_o, azimuth, channels); its angles are still unset.

    Where light is refracted it may end between two nodes, at the rim of the directions that it can have.
    """
    theta, azimuth, weight = grid.theta_o, grid.azimuth, grid.weights
    f = np.where(valid, f, 0.0)
    whole = filled(f, valid)
    value = np.sum(weight * whole, axis=(0, 1))
    u = np.where(valid & np.isfinite(u), u, 0.0)
    noise = np.sqrt(np.sum((weight * u) ** 2, axis=(0, 1)))
    floor = floor_of(value)
    # A negative reading has no logarithm: its place takes its neighbours', and the difference counts as bound.
    shown = filled(np.where(whole < 0, 0.0, whole), valid & (f >= 0))
    logs = log_values(shown, floor)
    errors = [prediction_error_across_pole(logs, theta, azimuth), prediction_error(logs, azimuth, 1, 2 * np.pi)]
    beyond_rim = np.zeros(f.shape[-1])
    if refracted:
        along = (with_rim(errors[0], logs, theta, shown <= floor, 0),
                 with_rim(errors[1], logs, azimuth, shown <= floor, 1, 2 * np.pi))  # fmt: skip
        errors = [rim.error for rim in along]
        beyond_rim = sum((np.sum(weight * shown * rim.inside, axis=(0, 1)) / 2 for rim in along), beyond_rim)
    missed = beyond_rim + np.sum(weight * excess(shown, floor, errors, u / np.maximum(shown, floor)), axis=(0, 1))
    missed += np.max([np.abs(half.integral(whole) - value) for half in grid.halves], axis=0)
    guessed = np.sum(weight * (np.where(valid, 0.0, np.abs(whole)) + np.abs(shown - whole)), axis=(0, 1))
    bound = missed + guessed + _beyond(whole, logs, theta, azimuth) + 2 * noise
    return Incidence(np.nan, np.nan, value, bound, noise, step_needed=_step_needed(shown, errors, theta))


def _step_needed(f: np.ndarray, errors: list[np.ndarray], theta: np.ndarray) -> float:
    # Two limits on the width of the lobe, as if it were a Gaussian: the prediction of nodes a step h apart errs by
    # h²/2w² along each axis; and of a lobe that is no brighter than all light together, f cosθ 2π w² ≤ 1. Resolved
    # where h ≤ w; half of that, as what lies between the nodes is commonly narrower.
    total = np.minimum(sum(errors), LARGEST)
    flux = f * np.cos(theta)[:, None, None]
    k = np.unravel_index(np.argmax(flux * np.expm1(total)), f.shape)
    by_slope = np.median(np.diff(theta)) * np.sqrt(RESOLVED / max(total[k], 1e-12))
    by_height = np.sqrt(1 / (2 * np.pi * max(flux.max(), 1e-12)))
    return float(min(by_slope, by_height) / 2)


def _once_around(phi: np.ndarray, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths once around, increasing, and the column that each comes from."""
    if not mirrored:
        n = phi.size - int(phi[-1] - phi[0] >= 2 * np.pi - 1e-9)
        return phi[:n], np.arange(n)
    both, column = np.concatenate([phi, 2 * np.pi - phi]), np.tile(np.arange(phi.size), 2)
    _, first = np.unique(np.round(np.mod(both, 2 * np.pi), 9), return_index=True)
    angles = np.mod(both[first], 2 * np.pi)
    order = np.argsort(angles)
    return angles[order], column[first][order]


def filled(f: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """f, (theta_o, azimuth, channels), where a cell without a reading takes the nearest of its ring, or azimuth."""
    if valid.all():
        return f
    out, have = f.copy(), valid.copy()
    for axis in (1, 0):
        # Around a ring only readings count; along an azimuth what the rings have filled in does too.
        values, known = (f, valid) if axis == 1 else (out, have)
        for step in range(1, f.shape[axis] // 2 + 1):
            for shift in (step, -step):
                there, value = (_shifted(a, shift, axis) for a in (known, values))
                take = ~have & there
                out[take], have[take] = value[take], True
            if have.all():
                return out
    return out


def _shifted(a: np.ndarray, step: int, axis: int) -> np.ndarray:
    rolled = np.roll(a, step, axis)
    if axis == 0:
        rolled[slice(step) if step > 0 else slice(step, None)] = 0
    return rolled


def _beyond(f: np.ndarray, logs: np.ndarray, theta: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    # The cap inside the first node and the rim outside the last: held constant, and as wrong as the slope there says.
    around = periodic_weights(azimuth)[:, None]
    total = np.zeros(f.shape[-1])
    for edge, inner, gap, share in (
        (0, 1, theta[0], np.sin(theta[0]) ** 2 / 2),
        (-1, -2, np.pi / 2 - theta[-1], np.cos(theta[-1]) ** 2 / 2),
    ):
        slope = np.abs(logs[edge] - logs[inner]) / np.abs(theta[edge] - theta[inner])
        grown = np.maximum(np.expm1(np.minimum(slope * gap, LARGEST)), 0.1 if gap > 1e-9 else 0.0)
        total = total + share * np.sum(around * np.abs(f[edge]) * grown, axis=0)
    return total
