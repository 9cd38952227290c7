"""The readings of tables without a grid of angles: which is nearest to a direction, and which are around it."""

import dataclasses
import functools
from typing import Any, cast

import numpy as np

from gonio.checks.direction_search import directions
from gonio.checks.table.albedos.half_difference import HalfVectorGrid, half_vector_grid
from gonio.checks.table.albedos.scattered import INCIDENCES
from gonio.checks.table.pairs.nearest_readings import FEWEST, by_incidence, valid_readings
from gonio.checks.table.pairs.pair_points import LEAF, isotropic_light, one_sided, pair_points
from gonio.checks.table.pairs.places import angles_of
from gonio.checks.table.pairs.scattered_pairs import merged
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.geometry.directions import from_spherical, to_half_difference

AROUND = 8
"""Readings around each, to which the ratio may change."""

FAR = np.radians(30.0)
"""What is farther from all readings was not read."""

AZIMUTHS = np.radians([0.0, 45.0, 90.0, 135.0])
"""Of incidences of which no reading tells, on surfaces that may be anisotropic."""

HALF_ANGLES = ("theta_h", "phi_h", "theta_d", "phi_d")
MOST_STEPS = 3
"""Cells without a reading farther than so many from the next one were not read."""


class _Field:
    """What both kinds of fields share: the geometry of their readings (n, ...)."""

    angles: np.ndarray

    @functools.cached_property
    def half_vectors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """theta_h, phi_h, theta_d, radians, and cosθi cosθo of each reading, (n,)."""
        wi, wo = (directions(self.angles[:, k], self.angles[:, k + 1]) for k in (0, 2))
        x, y, z = (a + b for a, b in zip(wi, wo, strict=True))
        length = np.sqrt(x**2 + y**2 + z**2)
        theta_d = np.arccos(np.clip(length / 2, 0, 1))
        return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x), theta_d, wi.z * wo.z


@dataclasses.dataclass(eq=False)
class NearestField(_Field):
    """Scattered readings: those of other incidences stand for a direction too, by the angles to it."""

    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray
    isotropic: bool
    mirrored: bool
    read: list[tuple[float, float]]
    """(theta_i, phi_i), radians, of which there are many readings, repeats included: as of the normal by azimuths."""

    @functools.cached_property
    def _tree(self) -> Any:
        from scipy.spatial import KDTree

        return KDTree(pair_points(self.angles, self.isotropic, self.mirrored), LEAF)

    @functools.cached_property
    def _around(self) -> tuple[np.ndarray, np.ndarray]:
        distance, number = self._tree.query(self._tree.data, k=min(AROUND, len(self.f)))
        return distance[:, 1:], number[:, 1:]

    def incidences(self) -> list[tuple[float, float]]:
        """(theta_i, phi_i), radians: those of many readings, else 0, 10, ... 80° as far as was read."""
        if self.read:
            return self.read
        low, high = self.angles[:, 0].min(), self.angles[:, 0].max()
        polar = INCIDENCES[(low - np.radians(5) <= INCIDENCES) & (high >= INCIDENCES)]
        return [(float(t), float(p)) for t in polar for p in (AZIMUTHS[:1] if self.isotropic else AZIMUTHS)]

    def nearest(
        self, incidence: tuple[float, float], theta_o: np.ndarray, phi_o: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Numbers of the readings nearest to directions, how many steps away they are (≥ 1), and which are too far."""
        angles = np.stack(
            [np.full(theta_o.size, incidence[0]), np.full(theta_o.size, incidence[1]), theta_o, phi_o], -1
        )
        distance, number = self._tree.query(pair_points(angles, self.isotropic, self.mirrored))
        step = np.median(self._around[0], axis=1)[number]
        return number, np.maximum(distance / np.maximum(step, 1e-9), 1.0), distance > FAR

    def change(self, logs: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """The largest |difference| of a logarithm (n, C) to the readings around, beyond that of their noise."""
        other = self._around[1]
        steps = np.abs(logs[:, None] - logs[other]) - np.hypot(noise[:, None], noise[other])
        return np.max(np.maximum(steps, 0.0), axis=1)


@dataclasses.dataclass(eq=False)
class HalfVectorField(_Field):
    """The readings (n,) of a half/difference table; cells without one take that of the nearest cell."""

    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray
    isotropic: bool
    grid: HalfVectorGrid
    source: np.ndarray
    """Number of the reading that stands for each cell of the table."""
    steps: np.ndarray
    """How many cells away that is."""

    def incidences(self) -> list[tuple[float, float]]:
        """(theta_i, phi_i), radians, as of `HalfVectorGrid.incidences`."""
        return self.grid.incidences()

    def nearest(
        self, incidence: tuple[float, float], theta_o: np.ndarray, phi_o: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As of `NearestField.nearest`."""
        theta_i, phi_i = (np.full_like(theta_o, a) for a in incidence)
        wi, wo = from_spherical(theta_i, phi_i, np), from_spherical(theta_o, phi_o, np)
        angles = {n: np.asarray(a) for n, a in zip(HALF_ANGLES, to_half_difference(wi, wo), strict=True)}
        cell, beyond = np.zeros(theta_o.size, int), np.ones(theta_o.size)
        for name, nodes in self.grid.axes.items():
            period = self.grid.periods[name]
            x = angles[name] if period is None else nodes[0] + np.mod(angles[name] - nodes[0], period)
            middle = (nodes[1:] + nodes[:-1]) / 2
            k = np.searchsorted(middle, x)
            if period is not None:
                k = np.where(x > (nodes[-1] + nodes[0] + period) / 2, 0, k)
            else:
                beyond += np.maximum(x - nodes[-1], 0.0) / (nodes[-1] - nodes[-2])
            cell = cell * nodes.size + k
        steps = self.steps[cell]
        return self.source[cell], beyond + steps, steps > MOST_STEPS

    def change(self, logs: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """As of `NearestField.change`: the sum over the axes."""
        shape = [nodes.size for nodes in self.grid.axes.values()]
        cells, theirs = (a[self.source].reshape(*shape, -1) for a in (logs, noise))
        total = np.zeros(cells.shape)
        for axis, name in enumerate(self.grid.axes):
            step = np.maximum(np.abs(np.diff(cells, axis=axis)) - _both(theirs, axis), 0.0)
            pad = [(0, 0)] * cells.ndim
            pad[axis] = (1, 1)
            step = np.pad(step, pad, mode="wrap" if self.grid.periods[name] is not None else "edge")
            total += np.maximum(np.take(step, range(shape[axis]), axis), np.take(step, range(1, shape[axis] + 1), axis))
        whole = np.zeros(logs.shape)
        np.maximum.at(whole, self.source, total.reshape(-1, logs.shape[1]))
        return whole


def _both(noise: np.ndarray, axis: int) -> np.ndarray:
    low, high = (np.take(noise, range(a, noise.shape[axis] + a - 1), axis) for a in (0, 1))
    return np.hypot(low, high)


def nearest_field(table: Table) -> NearestField | str:
    """The readings of a scattered table, repeats merged; or why they are too few."""
    angles, f, u = valid_readings(table)
    isotropic = isotropic_light(table)
    mirrored = isotropic and one_sided(angles)
    above = angles[:, 2] < np.pi / 2
    angles, f, u = angles[above], f[above], u[above]
    groups = by_incidence((angles, f, u), isotropic)
    read = [(float(np.median(a[:, 0])), float(a[0, 1])) for a, _, _ in groups if len(a) >= FEWEST]
    if len(f) >= FEWEST:
        angles, f, u, *_ = merged(angles, f, u, pair_points(angles, isotropic, mirrored))
    if len(f) < FEWEST:
        return f"it has {len(f)} readings, and {FEWEST} at different directions are needed"
    return NearestField(angles, f, np.nan_to_num(u), isotropic, mirrored, read)


def half_vector_field(table: Table) -> HalfVectorField | str:
    """The cells of a half/difference table; or why they do not cover the hemisphere."""
    from scipy.ndimage import distance_transform_cdt

    grid = half_vector_grid(table)
    if isinstance(grid, str):
        return grid
    shape = [nodes.size for nodes in grid.axes.values()]
    values = table.read_values(0, table.layout.size)
    valid = np.all(values["flag"] == Flag.VALID, axis=-1).reshape(shape)
    angles = angles_of(table.layout, np.arange(table.layout.size))
    valid &= (angles[:, [0, 2]] < np.pi / 2).all(axis=1).reshape(shape)
    if valid.mean() < 0.1:
        return "too many of its cells have no reading"
    steps, index = cast(Any, distance_transform_cdt(~valid, metric="taxicab", return_indices=True))
    source = np.ravel_multi_index(tuple(index), shape).ravel()
    read = np.flatnonzero(valid)
    number = np.searchsorted(read, source)
    f, u = (np.asarray(values[name], float).reshape(-1, len(table.channels))[read] for name in ("f", "u_f"))
    isotropic = "phi_h" not in grid.axes
    return HalfVectorField(angles[read], f, np.nan_to_num(u), isotropic, grid, number, steps.ravel())
