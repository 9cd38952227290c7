"""Directional albedos of half/difference tables: integrated over half vectors, between the table's own nodes.

dωo = 4 cosθd dωh [Walter 2007, eq. 14]. Lobes are narrow in theta_h alone, where the nodes are: f is interpolated, and
the geometry, whose kinks lie at the horizon, is integrated finely between the nodes.
"""

import dataclasses
from typing import Any

import numpy as np

from gonio.checks.albedos import Albedos, Incidence, albedos_of
from gonio.checks.grid_resolution import LARGEST, excess, hat_weights, log_values, prediction_error
from gonio.checks.hidden_lobes import Features, NearMirror, credible, hidden_energy
from gonio.checks.table.albedos.on_grid import MOST_MISSING, floor_of
from gonio.data.angles import SLACK
from gonio.data.flags import Flag
from gonio.data.interpolation.multilinear import InterpolationAxis
from gonio.data.table import Table
from gonio.models.geometry.directions import from_spherical

AZIMUTHS = 180
"""Azimuths of the half vector, even."""

POINTS = 180
"""About so many polar angles of the half vector."""

SECOND_ORDER = 0.25
"""Error of linear interpolation between nodes, in that of predicting them over twice the step."""

COARSER = 1.5
"""Factor on the change by every second node, which for smooth lobes is four times the error."""

FASTEST_GROWTH = 4.0

MOST_VALUES = 60_000_000
"""Values of a table that are held in memory at once."""

Corner = tuple[tuple[np.ndarray, ...], np.ndarray]
"""The cells to read f from, by their indices, and their shares: one corner of the cells about half vectors."""


@dataclasses.dataclass(frozen=True)
class HalfVectorGrid:
    """The axes of a half/difference layout and their periods, for integrals over half vectors."""

    axes: dict[str, np.ndarray]
    periods: dict[str, float | None]

    def half_angles(self) -> tuple[np.ndarray, np.ndarray]:
        """Polar angles of half vectors and their steps, radians: Gauss–Legendre between each two nodes and beyond."""
        edges = np.unique(np.concatenate([[0.0], self.axes["theta_h"], [np.pi / 2]]))
        x, w = np.polynomial.legendre.leggauss(max(2, -(-POINTS // edges.size)))
        half = np.diff(edges)[:, None] / 2
        return (edges[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()

    def half_vectors(self, theta_i: float, phi_i: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """cosθo dωo of each half vector, (theta_h, azimuths), and its angles by the names of the axes."""
        theta_h, step = self.half_angles()
        phi_h = (np.arange(AZIMUTHS) + 0.5) * 2 * np.pi / AZIMUTHS
        sin_h, cos_h = np.sin(theta_h)[:, None], np.cos(theta_h)[:, None]
        c, s = np.cos(phi_h)[None], np.sin(phi_h)[None]
        x, y, z = from_spherical(theta_i, phi_i, np)
        along, across = x * c + y * s, -x * s + y * c
        # The light in the half vector's frame: turned back by phi_h, then by theta_h.
        d_x, d_z = along * cos_h - z * sin_h, along * sin_h + z * cos_h
        cos_o = 2 * d_z * cos_h - z
        theta_d = np.arctan2(np.hypot(d_x, across), d_z)
        angles = {
            "theta_h": np.broadcast_to(theta_h[:, None], theta_d.shape),
            "theta_d": theta_d,
            "phi_d": np.arctan2(across, d_x),
            "phi_h": np.broadcast_to(phi_h, theta_d.shape),
        }
        w_h = (step * np.sin(theta_h))[:, None] * (2 * np.pi / AZIMUTHS)
        return np.where((d_z > 0) & (cos_o > 0), w_h * 4 * d_z * cos_o, 0.0), angles

    def corners(self, angles: dict[str, np.ndarray]) -> list[Corner]:
        """The cells to read f from at half vectors of these angles."""
        brackets, corners = [self._bracket(name, angles[name]) for name in self.axes], []
        for sides in np.ndindex(*[2] * len(brackets)):
            chosen = [(nodes[k], shares[k]) for (nodes, shares), k in zip(brackets, sides, strict=True)]
            corners.append((tuple(n for n, _ in chosen), np.prod([s for _, s in chosen], axis=0)))
        return corners

    def beyond(self, angles: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """How far half vectors lie beyond the last node of each polar angle, radians: f is held constant there."""
        return {name: np.maximum(angles[name] - self.axes[name][-1], 0.0) for name in ("theta_h", "theta_d")}

    def _bracket(self, name: str, x: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        nodes: Any = self.axes[name]
        axis = InterpolationAxis(nodes, self.periods[name], None, False, False)
        return axis.bracket(np.minimum(x, nodes[-1]) if axis.period is None else x, np)

    def hidden(self, theta_i: float, limit: np.ndarray) -> np.ndarray:
        """What a lobe about the normal may hide of an incidence, as of `hidden_energy`.

        `limit`, of the shape of the cells and channels: what it may be at each, 1/sr, at the most.
        """
        theta_h = self.axes["theta_h"]
        row = int(np.argmin(np.abs(self.axes["theta_d"] - theta_i)))
        least = limit[:, row].reshape(theta_h.size, -1, limit.shape[-1]).min(axis=1)
        cosines = np.cos(theta_i) * np.cos(np.maximum(theta_i - 2 * theta_h, 0.0))
        weight = 4 * cosines * hat_weights(theta_h, 0.0, np.pi / 2, lambda t: 2 * np.pi * np.sin(t) * np.cos(t))
        nodes = NearMirror(theta_h, np.zeros_like(theta_h), cosines, weight, np.arange(theta_h.size))
        return hidden_energy(nodes, least, isotropic=True)

    def incidences(self) -> list[tuple[float, float]]:
        """(theta_i, phi_i), radians: 0, 5, ... 85° (and azimuths 0, 45, 90, 135° where there is a phi_h)."""
        last = min(self.axes["theta_d"][-1], np.radians(85.0))
        theta = np.arange(0, np.degrees(last) + 1e-9, 5.0) * np.pi / 180
        azimuths = np.radians([0.0, 45.0, 90.0, 135.0]) if "phi_h" in self.axes else np.zeros(1)
        return [(t, p) for t in theta for p in azimuths]


def half_vector_grid(table: Table) -> HalfVectorGrid | str:
    """The half vectors of a table that cover the hemisphere, or why they do not."""
    axes = table.layout.axes
    if table.layout.size * len(table.channels) > MOST_VALUES:
        return "it is too large to be integrated in memory"
    if axes["theta_h"].size < 4 or axes["theta_h"][-1] < np.radians(60) - SLACK or axes["theta_d"].size < 4:
        return "its half vectors do not cover the hemisphere"
    if axes["phi_d"].size < 2:
        return "it holds one azimuth of the light about the half vector"
    return HalfVectorGrid(axes, table.layout.periods)


@dataclasses.dataclass(frozen=True)
class _Readings:
    """All readings of a table, of the shape of its cells and channels; `u` is None where no uncertainty is known."""

    grid: HalfVectorGrid
    f: np.ndarray
    u: np.ndarray | None
    valid: np.ndarray
    off: np.ndarray | None = None
    """What f may be off by near each node."""
    slopes: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    """Of each polar angle: the steepest |∂ log f| of the last steps to its last node, per radian, as of all cells."""

    def every_second(self, axis: int, first: int) -> "_Readings":
        name, some = list(self.grid.axes)[axis], (slice(None),) * axis + (slice(first, None, 2),)
        axes = {**self.grid.axes, name: self.grid.axes[name][first::2]}
        u = None if self.u is None else self.u[some]
        return _Readings(HalfVectorGrid(axes, self.grid.periods), self.f[some], u, self.valid[some])

    def albedo(self, theta_i: float, phi_i: float) -> Incidence:
        """The albedo with the bound that follows from `off`, the gaps and the noise; of what was read, at the least."""
        weight, angles = self.grid.half_vectors(theta_i, phi_i)
        corners, weight = self.grid.corners(angles), weight[..., None]
        beyond = {name: distance[..., None] for name, distance in self.grid.beyond(angles).items()}
        total, error, variance, have = np.zeros((4, *weight.shape[:2], self.f.shape[-1]))
        for cells, share in corners:
            w = share[..., None] * self.valid[cells]
            have += w
            total += w * self.f[cells]
            if self.off is not None:
                grown = sum((slope[cells] * beyond[name] for name, slope in self.slopes.items()), np.zeros(w.shape))
                error += w * (self.off[cells] + np.abs(self.f[cells]) * np.expm1(np.minimum(grown, LARGEST)))
            if self.u is not None:
                variance += (w * self.u[cells]) ** 2
        known = have > 1e-12
        scale = np.where(known, have, 1.0)
        gap = np.sum(weight * ~known, axis=(0, 1))
        mean = total / scale
        # Where corners had no reading the others stood for them, as wrong as they may be.
        guessed = np.sum(weight * np.abs(mean) * np.clip(1 - have, 0, 1), axis=(0, 1))
        empty = gap * np.max(np.abs(mean * (weight > 0)), initial=0.0) * 0.05
        noise = np.sqrt(np.sum(weight**2 * variance / scale**2, axis=(0, 1)))
        bound = np.sum(weight * error / scale, axis=(0, 1)) + guessed + empty + 2 * noise
        partial = bool(np.max(gap) > MOST_MISSING * np.pi)
        return Incidence(theta_i, phi_i, np.sum(weight * mean, axis=(0, 1)), bound, noise, partial=partial)

    def change_by_coarser(self, exact: Incidence) -> np.ndarray:
        """The largest change of an albedo by every second node of one axis: of theta_h by either half."""
        changes = []
        for k, (name, nodes) in enumerate(self.grid.axes.items()):
            for first in (0, 1) if name == "theta_h" else (0,):
                if nodes.size >= 4:
                    rough = self.every_second(k, first).albedo(exact.theta_i, exact.phi_i)
                    changes.append(np.inf if rough.partial > exact.partial else np.abs(rough.value - exact.value))
        return np.max([np.broadcast_to(change, exact.value.shape) for change in changes], axis=0)


def half_difference_albedos(table: Table, features: Features) -> Albedos | str:
    """Albedos at the incidences of `HalfVectorGrid.incidences`."""
    grid = half_vector_grid(table)
    if isinstance(grid, str):
        return grid
    valid = np.asarray(table.flag[...]) == Flag.VALID
    f = np.where(valid, np.asarray(table.f[...], dtype=float), 0.0)
    u = None if table.u_f is None else np.nan_to_num(np.where(valid, np.asarray(table.u_f[...], float), 0.0))
    readings = _Readings(grid, f, u, valid)
    typical = readings.albedo(np.radians(40.0), 0.0)
    if typical.partial:
        return "too many of its cells have no reading"
    floor = floor_of(typical.value)
    # A neighbour without a reading tells nothing of its node.
    logs = np.where(valid, log_values(f, floor), np.nan)
    errors = [
        np.nan_to_num(prediction_error(logs, nodes, k, grid.periods[name]))
        for k, (name, nodes) in enumerate(grid.axes.items())
    ]
    noise = 0.0 if u is None else u / np.maximum(f, floor)
    errors[1] = _grown_at_the_end(errors[1])
    errors[1:] = [e + _bend(logs, k) for k, e in enumerate(errors[1:], 1)]
    # In theta_h errors on a lobe's flanks and at its peak cancel; in the other angles f bends one way.
    off = (excess(f, floor, errors[:1], noise) + excess(f, floor, errors[1:], noise, SECOND_ORDER)) * valid
    slopes = {name: _last_slopes(logs, nodes, k) for k, (name, nodes) in enumerate(grid.axes.items()) if k < 2}
    readings = dataclasses.replace(readings, off=off, slopes=slopes)
    rows = [readings.albedo(t, p) for t, p in grid.incidences()]
    rows = [row._replace(bound=row.bound + COARSER * readings.change_by_coarser(row)) for row in rows]
    if 2 * grid.axes["theta_h"][0] > features.reach:
        limit = np.where(valid, np.maximum(f, 0.0) + (0.0 if u is None else 2 * u), np.inf)
        rows = [row._replace(hidden=grid.hidden(row.theta_i, credible(limit, row.value))) for row in rows]
    return albedos_of(rows, "Integrated over half vectors, interpolated between the table's own nodes.", features)


def _last_slopes(logs: np.ndarray, nodes: np.ndarray, axis: int) -> np.ndarray:
    steps = np.diff(np.moveaxis(logs, axis, 0)[-3:], axis=0) / np.diff(nodes[-3:]).reshape(-1, *[1] * (logs.ndim - 1))
    steepest = np.max(np.nan_to_num(np.abs(steps)), axis=0)
    return np.broadcast_to(np.expand_dims(steepest, axis), logs.shape)


def _grown_at_the_end(error: np.ndarray) -> np.ndarray:
    # Towards grazing the error of theta_d grows from node to node, and the last node has no neighbour to show it.
    error = error.copy()
    growth = error[:, -2] / np.maximum(error[:, -3], 1e-12)
    error[:, -1] = np.minimum(error[:, -2] * np.clip(growth, 1.0, FASTEST_GROWTH), LARGEST)
    return error


def _bend(logs: np.ndarray, axis: int) -> np.ndarray:
    # What linear interpolation makes of an exponential of Δ e-folds a step, Δ²/8, as four times as much a prediction.
    steps = np.nan_to_num(np.abs(np.diff(np.moveaxis(logs, axis, 0), axis=0)))
    steps = np.maximum(np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]]))
    return np.moveaxis(np.minimum(steps**2 / 2, LARGEST), 0, axis)
