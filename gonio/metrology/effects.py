"""What each source of error does to a table's readings: shifts that all of them share, and parts of their noise."""

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

from gonio.data.flags import Flag
from gonio.data.interpolation.multilinear import as_material
from gonio.data.interpolation.two_sided import TwoSided
from gonio.data.stated import TERMS
from gonio.data.table import Table
from gonio.fitting.apertures import half_angles_of
from gonio.instrument.aperture import irradiance
from gonio.instrument.instrument import Instrument, Systematic
from gonio.instrument.noise import variance_parts
from gonio.models.brdf import AbstractBRDF
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction, normalize
from gonio.models.geometry.sides import FRONT

POLAR = ("theta_i", "theta_o", "theta_h", "theta_d")
RING = 8
"""Directions about the centre of an aperture's disc."""


def interpolated(table: Table) -> AbstractBRDF:
    """The interpolant of a gridded table, made for small shifts of the angles.

    Its outermost polar angles are continued by the slope there: it would be constant beyond them, and a shift do half
    as much. At a pole all azimuths are one direction, and have the mean of their readings.
    """
    if table.sides != FRONT:
        parts = {sides: interpolated(part) for sides, part in table.parts().items() if part.valid_cells().size}
        return TwoSided(tuple(parts.values()), tuple(parts))
    for polar, azimuth in table.layout.pole_axes:
        if azimuth in table.layout.axes and table.layout.axes[polar][0] == 0:
            table = _one_at_the_pole(table, polar, azimuth)
    for name, nodes in table.layout.axes.items():
        if name not in POLAR or nodes.size < 2:
            continue
        for first in (False, True) if nodes[0] < 0 else (False,):
            table = _continued(table, name, first)
    return as_material(table)


def _one_at_the_pole(table: Table, polar: str, azimuth: str) -> Table:
    names = list(table.layout.axes)
    pole: list[slice] = [slice(None)] * (len(names) + 1)
    pole[names.index(polar)] = slice(0, 1)
    f, flag = np.array(table.f[...], float), np.array(table.flag[...])
    valid = flag[*pole] == Flag.VALID
    count = valid.sum(axis=names.index(azimuth), keepdims=True)
    total = np.where(valid, f[*pole], 0.0).sum(axis=names.index(azimuth), keepdims=True)
    f[*pole] = np.where(valid, total / np.maximum(count, 1), f[*pole])
    return dataclasses.replace(table, f=f, flag=flag)


def _continued(table: Table, name: str, first: bool) -> Table:
    nodes, axis = table.layout.axes[name], list(table.layout.axes).index(name)
    edge, inner = (0, 1) if first else (-1, -2)
    beyond = float(np.clip(2 * nodes[edge] - nodes[inner], -np.pi / 2, np.pi / 2))
    if abs(beyond - nodes[edge]) < 1e-6:
        return table
    f, flag = (np.asarray(a[...]) for a in (table.f, table.flag))
    here, there = (np.take(f, [k], axis).astype(float) for k in (edge, inner))
    share = (beyond - nodes[edge]) / (nodes[edge] - nodes[inner])
    both = [np.take(flag, [k], axis) for k in (edge, inner)]
    ends = here + share * (here - there), np.maximum(*both)
    order = (1, 0) if first else (0, 1)
    f, flag = (np.concatenate([(a, e)[k] for k in order], axis) for a, e in zip((f, flag), ends, strict=True))
    axes = {**table.layout.axes, name: np.concatenate([(nodes, [beyond])[k] for k in order])}
    return dataclasses.replace(table, layout=type(table.layout)(axes), f=f, flag=flag, u_f=None)


@dataclasses.dataclass(frozen=True)
class Readings:
    """All cells of a table that have a reading: numbers, angles (4, n), values (n, C), and f in between them."""

    table: Table
    cells: np.ndarray
    angles: np.ndarray
    f: np.ndarray
    model: AbstractBRDF | None
    """What tells how f changes between the readings; None where nothing does."""
    step: float = 0.0
    """Radians: a grid's, where its interpolant is the model, which tells no curvature within it."""

    @classmethod
    def of(cls, table: Table, model: AbstractBRDF | None) -> "Readings":
        """Of a table; `model` fits it, else a grid is interpolated."""
        cells = table.valid_cells()
        angles = np.stack([np.asarray(a)[cells] for a in table.layout.angles()])
        f = np.nan_to_num(np.asarray(table.values_at(cells)["f"], float))
        if model is None and table.layout.gridded:
            return cls(table, cells, angles, f, interpolated(table), _grid_step(table))
        return cls(table, cells, angles, f, model)

    def read(self, error: Systematic) -> np.ndarray:
        """Readings (n, C) with a systematic error, by the model in between."""
        assert self.model is not None
        half_angle = half_angles_of(self.table)[0]
        wi, wo = error.true_directions(tuple(self.angles))
        f = evaluate_in_blocks(self.model, wi, wo)
        share = irradiance(np.abs(wi.z), half_angle) / irradiance(np.abs(np.cos(self.angles[0])), half_angle)
        return error.gain * f * share[:, None] + error.offset / (np.pi * self.lit[:, None])

    @property
    def lit(self) -> np.ndarray:
        """Irradiance (n,) relative to normal incidence."""
        return irradiance(np.abs(np.cos(self.angles[0])), half_angles_of(self.table)[0])

    def shift(self, name: str, size: float) -> np.ndarray | None:
        """Change of all readings (n, C) by an error of a term; None where nothing tells how f depends on the angles."""
        acts = TERMS[name].acts
        if acts == "factor":
            return size * self.f
        if acts == "offset":
            return np.broadcast_to(size / (np.pi * self.lit[:, None]), self.f.shape)
        if self.model is None:
            return None
        high, low = (self.read(Systematic(**{name: sign * size})) for sign in (1, -1))
        # Out of the plane of an in-plane table nobody looked: a mirror-symmetric f does not change there.
        return np.broadcast_to(np.nan_to_num((high - low) / 2), self.f.shape)

    @functools.cached_property
    def nominal(self) -> np.ndarray:
        """Readings (n, C) without an error, by the model in between."""
        return self.read(Systematic())

    def change(self, errors: Mapping[str, float]) -> np.ndarray:
        """Change of all readings (n, C) by systematic errors together, not only to first order."""
        factor, offset, turned = self._parts(errors)
        return factor * (self.f + turned) + offset - self.f

    def correction(self, errors: Mapping[str, float]) -> np.ndarray:
        """Change of all readings (n, C) that takes systematic errors out of them, not only to first order."""
        factor, offset, turned = self._parts(errors)
        return (self.f - offset) / factor - turned - self.f

    def _parts(self, errors: Mapping[str, float]) -> tuple[float, np.ndarray, np.ndarray]:
        """The factor of all readings, what is added to them (n, 1), and the change by the turned directions (n, C)."""
        factor = math.prod(1 + e for name, e in errors.items() if TERMS[name].acts == "factor")
        offset = sum(e for name, e in errors.items() if TERMS[name].acts == "offset")
        angles = {name: e for name, e in errors.items() if TERMS[name].acts == "angle"}
        turned = np.zeros_like(self.f)
        if self.model is not None and angles:
            turned = np.nan_to_num(self.read(Systematic(**angles)) - self.nominal)
        return factor, offset / (np.pi * self.lit[:, None]), turned

    def averaged_over_discs(self) -> np.ndarray | None:
        """By how much readings (n, C) are off by being averages over the discs of light and detector.

        To second order in their half-angles a: (a²/8)∇²f, by the mean of f on rings about both directions.
        """
        discs, total = half_angles_of(self.table), np.zeros_like(self.f)
        if self.model is None:
            return None
        pair = [from_angles(*self.angles[k : k + 2]) for k in (0, 2)]
        centre = evaluate_in_blocks(self.model, *pair)
        for side, half_angle in enumerate(discs):
            if not half_angle:
                continue
            radius = max(half_angle / math.sqrt(2.0), self.step)
            for k in range(RING):
                moved = list(pair)
                moved[side] = _beside(pair[side], radius, 2 * math.pi * k / RING)
                change = np.nan_to_num(evaluate_in_blocks(self.model, *moved) - centre)
                total += change / RING * (half_angle**2 / 2) / radius**2
        return total

    def moved(self, shift: np.ndarray) -> Table:
        """The table with all readings shifted."""
        f = np.array(self.table.f[...], float).reshape(self.table.layout.size, -1)
        f[self.cells] += shift
        return dataclasses.replace(self.table, f=f.reshape(self.table.shape))


def from_angles(theta: np.ndarray, phi: np.ndarray) -> Direction:
    """Directions of polar angles and azimuths, radians."""
    return Direction(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))


def _beside(w: Direction, radius: float, around: float) -> Direction:
    """Directions at a distance of others, kept on their side of the horizon."""
    theta, phi = np.arctan2(np.hypot(w.x, w.y), w.z), np.arctan2(w.y, w.x)
    along = Direction(np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta))
    across = Direction(-np.sin(phi), np.cos(phi), np.zeros_like(phi))
    c, s = math.tan(radius) * math.cos(around), math.tan(radius) * math.sin(around)
    moved = Direction(*(a + c * b + s * d for a, b, d in zip(w, along, across, strict=True)))
    x, y, z = (np.asarray(a) for a in normalize(moved))
    return Direction(x, y, np.where(w.z > 0, np.maximum(z, 1e-4), np.minimum(z, -1e-4)))


def _grid_step(table: Table) -> float:
    steps = [np.median(np.diff(axis)) for name, axis in table.layout.axes.items() if name in POLAR and axis.size > 1]
    return float(max(steps, default=0.0))


def noise_parts(table: Table, instrument: Instrument | None) -> dict[str, np.ndarray]:
    """Standard uncertainties of the readings, of the shape of the table, by their sources; one where none are known.

    Those that the table stores, shared out as the instrument's signal chain makes them.
    """
    u_f = np.nan_to_num(np.asarray(table.u_f[...], float))
    if instrument is None or not instrument.has_noise:
        return {"readings": u_f}
    valid = np.asarray(table.flag[...]) == Flag.VALID
    f = np.where(valid, np.nan_to_num(np.asarray(table.f[...], float)), 0.0).reshape(table.layout.size, -1)
    lit = np.maximum(irradiance(np.abs(table.layout.cosines()[0]), instrument.source_half_angle), 1e-6)
    parts = variance_parts(instrument, f, lit)
    total = np.maximum(sum(parts.values()), 1e-300)
    shares = {name: np.sqrt(part / total).reshape(table.shape) for name, part in parts.items() if np.any(part)}
    return {name: u_f * share for name, share in shares.items()}
