"""What a table's readings are integrated and averaged to: albedos, and reflectance factors where they were read.

All of them are linear in the readings, so that an error of the readings moves each by the same function of that error.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos, hemispherical
from gonio.checks.table.energy import STANDARD_UNCERTAINTIES, table_albedos
from gonio.data.flags import Flag
from gonio.data.table import COPIED, Table
from gonio.models.errors import GonioError

NAMED = ("0:45", "45:0")
"""Geometries, theta_i:theta_o in degrees, that standards name: looked for in every table."""
SAME = math.radians(0.1)
"""A direction was read where a reading is so near."""
ALBEDO, UNIFORM, FACTOR = "albedo", "albedo under uniform light", "reflectance factor"
TRANSMITTANCE, ABSORPTANCE, THROUGH_FACTOR = "transmittance", "absorptance", "transmittance factor"
DIRECTIONAL = (ALBEDO, TRANSMITTANCE, ABSORPTANCE)
"""Quantities that are listed for each incidence."""


@dataclasses.dataclass(frozen=True)
class Quantity:
    """One number: what it is, where (in words and as angles in degrees), of which channel, and its value.

    `bound`: how far it may be off by computing it (of a table: by what lies between and beyond the readings); infinite
    where there is no such bound.
    """

    name: str
    place: str
    channel: str
    value: float
    bound: float
    angles: dict[str, float] = dataclasses.field(default_factory=dict)
    unit: str = "1"

    def text(self, u: float) -> str:
        """The value to two digits of an uncertainty u, or that this leaves nothing of it."""
        if not u > 0:
            return f"{self.value:.6g}"
        return f"{round(self.value, 1 - math.floor(math.log10(u))):.6g}" if u < abs(self.value) else "not known"


class Geometry(NamedTuple):
    """Directions by polar angles and azimuth difference, radians; None: any azimuth difference that was read."""

    text: str
    theta_i: float
    theta_o: float
    delta_phi: float | None

    @classmethod
    def of(cls, text: str) -> "Geometry":
        """The geometry of a text theta_i:theta_o or theta_i:theta_o:delta_phi in degrees; 180 is the mirror side.

        Raises GonioError for another text.
        """
        try:
            numbers = [float(part) for part in text.split(":")]
        except ValueError:
            numbers = []
        polar = all(0 <= n <= 180 and n != 90 for n in numbers[:2])
        inside = len(numbers) in (2, 3) and polar and all(map(math.isfinite, numbers))
        if not inside:
            raise GonioError(
                f"{text!r} is no geometry; give theta_i:theta_o or theta_i:theta_o:delta_phi in degrees, such as 45:0"
                " or 30:30:180"
            )
        theta_i, theta_o = map(math.radians, numbers[:2])
        if len(numbers) == 3:
            return cls(text.strip(), theta_i, theta_o, math.radians(numbers[2] % 360))
        return cls(text.strip(), theta_i, theta_o, None if 0 in numbers[:2] else math.pi)

    def cells(self, table: Table) -> np.ndarray:
        """Numbers of the cells with a valid reading there."""
        theta_i, phi_i, theta_o, phi_o = (np.asarray(a) for a in table.layout.angles())
        here = (np.abs(theta_i - self.theta_i) < SAME) & (np.abs(theta_o - self.theta_o) < SAME)
        if self.delta_phi is not None:
            off = np.abs(np.mod(phi_o - phi_i - self.delta_phi + np.pi, 2 * np.pi) - np.pi)
            here &= off * np.minimum(np.sin(theta_o), np.sin(theta_i)) < SAME
        cells = np.flatnonzero(here)
        flag = table.values_at(cells)["flag"]
        return cells[(flag == Flag.VALID).all(axis=1)]


class Readout(NamedTuple):
    """Of Q quantities (Q,): values, bounds on what is between the readings, standard uncertainties by `u_f`."""

    values: np.ndarray
    bounds: np.ndarray
    noise: np.ndarray


@dataclasses.dataclass(frozen=True)
class TableMeasurands:
    """The quantities of a table, which can be read out again of the same table with other values or uncertainties."""

    table: Table
    quantities: list[Quantity]
    factors: list[tuple[Geometry, np.ndarray]]
    whole: np.ndarray
    """Which incidences (n,) have an albedo."""
    notes: list[str]
    base: Readout
    """Of the table as it is."""

    @classmethod
    def of(cls, table: Table, geometries: Sequence[str] = ()) -> "TableMeasurands":
        """The quantities of a table: those that can be computed, and reflectance factors at `NAMED` and `geometries`.

        Raises GonioError for a geometry of these that was not read.
        """
        albedos, notes = table_albedos(table), []
        whole = np.zeros(0, bool)
        if isinstance(albedos, str):
            notes.append(f"There is no albedo: {albedos}.")
        else:
            whole = ~albedos.partial & np.isfinite(albedos.value).all(axis=1)
            if not whole.all():
                unread = ", ".join(f"{t:.4g}°" for t in np.unique(np.degrees(albedos.theta_i[~whole]).round(6)))
                notes.append(f"There is no albedo at θi {unread}: too little of the hemisphere was read.")
        factors = _factors(table, geometries)
        nothing = np.zeros(0)
        made = cls(table, [], factors, whole, notes, Readout(nothing, nothing, nothing))
        base, labels = made._parts(table, albedos), made._labels(albedos)
        rows = [
            Quantity(*label[:3], float(v), float(b), label[3])
            for label, v, b in zip(labels, base.values, base.bounds, strict=True)
        ]
        return dataclasses.replace(made, quantities=rows, base=base)

    def read_out(self, table: Table) -> Readout:
        """Values, bounds and noise of all quantities, of the same table with other f or u_f."""
        return self._parts(table, table_albedos(table) if self.whole.any() else "")

    def _parts(self, table: Table, albedos: Albedos | str) -> Readout:
        parts = []
        if not isinstance(albedos, str) and self.whole.any():
            value, noise = albedos.value[self.whole], albedos.noise[self.whole]
            bound = np.maximum(albedos.above, albedos.below)[self.whole] - STANDARD_UNCERTAINTIES * noise
            parts.append(Readout(value.ravel(), bound.ravel(), noise.ravel()))
            parts.append(_uniform_light(albedos.theta_i[self.whole], value, bound, noise))
        copied = COPIED in table.provenance
        for _, cells in self.factors:
            block = table.values_at(cells)
            u = np.nan_to_num(np.asarray(block["u_f"], float))
            spread = np.mean(u, axis=0) if copied else np.sqrt(np.sum(u**2, axis=0)) / cells.size
            mean = np.mean(np.asarray(block["f"], float), axis=0)
            parts.append(Readout(np.pi * mean, np.zeros(mean.size), np.pi * spread))
        if not parts:
            return Readout(np.zeros(0), np.zeros(0), np.zeros(0))
        return Readout(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _labels(self, albedos: Albedos | str) -> list[tuple[str, str, str, dict[str, float]]]:
        names, labels = self.table.channels.names, []
        if not isinstance(albedos, str) and self.whole.any():
            theta, phi = (np.degrees(a[self.whole]).round(9).tolist() for a in (albedos.theta_i, albedos.phi_i))
            turned = len(set(phi)) > 1
            for t, p in zip(theta, phi, strict=True):
                place = f"θi {t:.4g}°" + (f", φi {p:.4g}°" if turned else "")
                labels += [(ALBEDO, place, c, {"theta_i": t} | ({"phi_i": p} if turned else {})) for c in names]
            labels += [(UNIFORM, "", c, {}) for c in names]
        for g, _ in self.factors:
            angles = {"theta_i": math.degrees(g.theta_i), "theta_o": math.degrees(g.theta_o)}
            angles |= {} if g.delta_phi is None else {"delta_phi": math.degrees(g.delta_phi)}
            labels += [(FACTOR, g.text, c, {k: round(v, 9) for k, v in angles.items()}) for c in names]
        return labels


def _factors(table: Table, geometries: Sequence[str]) -> list[tuple[Geometry, np.ndarray]]:
    factors = []
    for text in dict.fromkeys([*NAMED, *geometries]):
        geometry = Geometry.of(text)
        cells = geometry.cells(table)
        if cells.size:
            factors.append((geometry, cells))
        elif text in geometries:
            raise GonioError(
                f"nothing was read at {text} (within {math.degrees(SAME):g}°); {_nearest(table, geometry)}"
            )
    return factors


def _nearest(table: Table, geometry: Geometry) -> str:
    theta_i, phi_i, theta_o, phi_o = (np.asarray(a)[table.valid_cells()] for a in table.layout.angles())
    turn = np.mod(phi_o - phi_i, 2 * np.pi)
    wanted = geometry.delta_phi or 0.0
    distance = (theta_i - geometry.theta_i) ** 2 + (theta_o - geometry.theta_o) ** 2
    distance += (np.sin(theta_i) * np.sin(theta_o)) * 2 * (1 - np.cos(turn - wanted))
    if not distance.size:
        return "it has no valid reading"
    k = int(np.argmin(distance))
    angles = (f"{math.degrees(a[k]):.6g}" for a in (theta_i, theta_o, turn))
    return f"the nearest reading is at {':'.join(angles)}"


def _uniform_light(theta: np.ndarray, value: np.ndarray, bound: np.ndarray, noise: np.ndarray) -> Readout:
    """The albedo under uniform light from directional ones (n, C), whose noise is independent."""
    known = np.where(np.isfinite(bound), bound, 0.0)
    total, missed = hemispherical(theta, value, known)
    missed = np.where(np.isfinite(bound).all(axis=0), missed, np.inf)
    of_values = functools.partial(hemispherical, theta, bound=known)
    variance = np.zeros_like(total)
    for k in np.flatnonzero(noise.any(axis=1)):
        step = np.zeros_like(value)
        step[k] = noise[k]
        variance += (of_values(value + step)[0] - total) ** 2
    return Readout(total, missed, np.sqrt(variance))


def to_row(quantity: Quantity) -> dict[str, Any]:
    """A quantity as plain data."""
    angles = {f"{name}_deg": angle for name, angle in quantity.angles.items()}
    row = {"name": quantity.name, "place": quantity.place, "channel": quantity.channel, **angles}
    return row | {"value": quantity.value, "bound": quantity.bound, "unit": quantity.unit}
