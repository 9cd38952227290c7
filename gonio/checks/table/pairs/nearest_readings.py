"""Scattered readings by incidence, and what of the hemisphere each of them stands for: the directions nearest to it."""

from typing import Any, NamedTuple

import numpy as np

from gonio.checks.albedos import Incidence
from gonio.checks.direction_search import directions
from gonio.checks.hidden_lobes import REFLECTED, Features, NearMirror, hidden_energy, refracted
from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.pair_points import LEAF, isotropic_light, one_sided
from gonio.checks.table.pairs.places import angles_of
from gonio.checks.table.pairs.scattered_pairs import merged
from gonio.data.table import Table
from gonio.models.geometry.low_discrepancy import low_discrepancy

POINTS, MOST_POINTS = 4000, 200_000
"""Directions of the hemisphere, even in projected solid angle, that take the values of the readings near them."""

POINTS_EACH = 8
"""So many of them for each reading, within these limits."""

FARTHEST = np.radians(12.0)
SURROUNDING = 8
"""Nearest readings that have to lie on all sides of a direction for it to count as read."""

MOST_UNCOVERED = 0.1
SAME_LIGHT = np.radians(0.05)
FEWEST = 20

AnglesAndReadings = tuple[np.ndarray, np.ndarray, np.ndarray]
"""theta_i, phi_i, theta_o, phi_o, radians, (n, 4); f and its standard uncertainty, (n, C)."""


def valid_readings(table: Table) -> AnglesAndReadings:
    """All readings of a scattered table that are valid in each channel, with the light above the horizon."""
    cells = np.arange(table.layout.size)
    angles = angles_of(table.layout, cells)
    f, u = readings_of(table, cells)
    use = np.isfinite(f).all(axis=1) & (angles[:, 0] < np.pi / 2)
    return angles[use], f[use], np.nan_to_num(u[use])


def by_incidence(readings: AnglesAndReadings, isotropic: bool) -> list[AnglesAndReadings]:
    """The readings of each incidence."""
    angles = readings[0]
    key = angles[:, :1] if isotropic else np.where(angles[:, :1] < 1e-9, 0.0, angles[:, :2])
    groups = np.unique(np.round(key / SAME_LIGHT).astype(int), axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(groups, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(groups))[:-1]) if order.size else []
    return [(readings[0][one], readings[1][one], readings[2][one]) for one in parts]


class Light(NamedTuple):
    """What holds for every incidence of a table; `bend` as of `HemisphereGrid.distance_to_mirror`."""

    mirrored: bool
    isotropic: bool
    bend: float
    features: Features

    def cells(self, readings: AnglesAndReadings) -> "Cells | Incidence":
        """What of the hemisphere each of an incidence's readings stands for; an empty albedo where they are too few."""
        from scipy.spatial import KDTree

        angles, f, u = readings
        incidence = float(np.median(angles[:, 0])), float(angles[0, 1])
        # Several readings of one direction, as of the normal, are one: its neighbours are those of other directions.
        angles, f, u, *_ = merged(angles, f, u, outgoing(angles, self.mirrored))
        nothing = np.zeros(f.shape[1])
        if len(f) < FEWEST:
            return Incidence(*incidence, nothing, nothing, nothing, partial=True)
        points = int(np.clip(POINTS_EACH * len(f), POINTS, MOST_POINTS))
        point = low_discrepancy(points, 2)
        theta, phi = np.arcsin(np.sqrt(point[:, 0])), 2 * np.pi * point[:, 1]
        wanted = np.stack([np.full(points, incidence[0]), np.full(points, incidence[1]), theta, phi], -1)
        wanted, tree = outgoing(wanted, self.mirrored), KDTree(outgoing(angles, self.mirrored), LEAF)
        distance, near = (np.asarray(a) for a in tree.query(wanted, k=4))
        weight = np.bincount(near[:, 0], minlength=len(f)) * np.pi / points
        return Cells(incidence, angles, f, u, tree, wanted, near, distance[:, 0] > FARTHEST, weight)

    def hidden(self, cells: "Cells", limit: np.ndarray) -> np.ndarray | None:
        """What a lobe may hide that is at most `limit` (n, C) at the readings; see `hidden_energy`; None: seen."""
        theta_i, phi_i = cells.incidence
        lobe = theta_i if self.bend == 1.0 else np.arcsin(min(self.bend * np.sin(theta_i), 1.0))
        mirror = outgoing(np.array([[theta_i, phi_i, lobe, phi_i + np.pi]]), self.mirrored)
        distance = cells.tree.query(mirror)[0][0]
        if distance <= self.features.reach or cells.partial:
            return None
        theta_o, phi_o = cells.angles[:, 2], cells.angles[:, 3] - cells.angles[:, 1] + phi_i
        nodes = NearMirror.of(cells.incidence, theta_o, phi_o, cells.weight, self.bend)
        lobes = REFLECTED if self.bend == 1.0 else refracted(theta_i, self.bend)
        return hidden_energy(nodes, limit[nodes.number], self.isotropic, lobes)


class Cells(NamedTuple):
    """An incidence's readings; directions over the hemisphere, the four readings nearest to each, and which are far."""

    incidence: tuple[float, float]
    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray
    tree: Any
    wanted: np.ndarray
    near: np.ndarray
    uncovered: np.ndarray
    weight: np.ndarray
    """(n,), sr: projected solid angle that each reading stands for."""

    @property
    def partial(self) -> bool:
        """Whether too much of the hemisphere was not read."""
        return bool(self.uncovered.mean() > MOST_UNCOVERED)

    def surrounded(self) -> np.ndarray:
        """Whether the directions have near readings on all sides: no half plane about them is without one."""
        points = self.wanted
        _, near = self.tree.query(points, k=min(SURROUNDING, self.tree.n))
        offset = self.tree.data[near] - points[:, None]
        across = np.cross(points, np.where(np.abs(points[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
        along = np.cross(points, across)
        x, y = (np.einsum("nkc,nc->nk", offset, axis) for axis in (across, along))
        angle = np.sort(np.arctan2(y, x), axis=1)
        gaps = np.diff(angle, axis=1, append=angle[:, :1] + 2 * np.pi)
        return gaps.max(axis=1) < np.pi


def lights(table: Table, features: Features, bend: float) -> tuple[Light, list[AnglesAndReadings]]:
    """What holds for every incidence of a scattered table, and the readings of each."""
    readings = valid_readings(table)
    isotropic = isotropic_light(table)
    light = Light(isotropic and one_sided(readings[0]), isotropic, bend, features)
    return light, by_incidence(readings, isotropic)


def outgoing(angles: np.ndarray, mirrored: bool) -> np.ndarray:
    """The detector's directions (n, 3) of angles (n, 4), with the light at azimuth 0; mirrored: on one side of it."""
    theta, phi = angles[:, 2], angles[:, 3] - angles[:, 1]
    if mirrored:
        phi = np.abs(np.mod(phi + np.pi, 2 * np.pi) - np.pi)
    return np.stack(directions(theta, phi), -1)
