"""What a table's readings are integrated and averaged to: albedos, and reflectance factors where they were read.

All of them are linear in the readings, so that an error of the readings moves each by the same function of that error.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos, hemispherical
from gonio.checks.table.energy import STANDARD_UNCERTAINTIES, albedos_by_side
from gonio.checks.table.one_azimuth import azimuth_dependence
from gonio.data.flags import Flag
from gonio.data.table import COPIED, Table
from gonio.metrology.quantity import Quantity
from gonio.metrology.standards.reflectance import stated
from gonio.metrology.standards.shared import once
from gonio.metrology.standards.standard import StandardQuantity
from gonio.metrology.standards.table_standards import TableStandards
from gonio.models.errors import GonioError

THROUGH = ("0:180",)
"""Of what transmits: straight through."""
NAMED = ("0:45", "45:0")
"""Geometries, theta_i:theta_o in degrees, that standards name: looked for in every table."""
FRONT_TO_FRONT = (1, 1)
"""Sides of light and detector."""
SAME = math.radians(0.1)
"""A direction was read where a reading is so near."""
UNIFORM_THROUGH = "transmittance under uniform light"
ALBEDO, UNIFORM, FACTOR = "albedo", "albedo under uniform light", "reflectance factor"
BHR, WHITE_SKY = "BHR", "white sky"
"""The albedo under uniform light by its name in remote sensing."""
TRANSMITTANCE, ABSORPTANCE, THROUGH_FACTOR = "transmittance", "absorptance", "transmittance factor"
STANDARDS = {
    ALBEDO: "CIE S 017, R(θi;2π)",
    UNIFORM: "CIE S 017, R(2π;2π)",
    TRANSMITTANCE: "CIE S 017, T(θi;2π)",
    UNIFORM_THROUGH: "CIE S 017, T(2π;2π)",
    FACTOR: "CIE 15:2018, single directions",
    BHR: "Schaepman-Strub et al. 2006",
    THROUGH_FACTOR: "CIE S 017, single directions",
}
"""Who names them so."""
AT_NORMAL = 1e-6
"""Polar angle, degrees, up to which a direction is the normal, which has no azimuth."""
DIRECTIONAL = (ALBEDO, TRANSMITTANCE, ABSORPTANCE)
"""Quantities that are listed for each incidence."""


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

    @property
    def through(self) -> bool:
        """Whether light and detector are on different sides."""
        return (self.theta_i > math.pi / 2) != (self.theta_o > math.pi / 2)

    def between(self) -> StandardQuantity:
        """The factor there, as the readings around it give it."""
        turn = 0.0 if self.delta_phi is None else self.delta_phi
        return stated(self.text, *(round(math.degrees(a), 9) for a in (self.theta_i, self.theta_o, turn)))

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


class Share(NamedTuple):
    """Sides of light and detector, and which of the incidences (n,) have an albedo, or a transmittance, there."""

    sides: tuple[int, int]
    whole: np.ndarray

    @property
    def through(self) -> bool:
        """Whether it is a transmittance."""
        return self.sides[0] != self.sides[1]


SidedAlbedos = Mapping[tuple[int, int], Albedos | str]


@dataclasses.dataclass(frozen=True)
class TableMeasurands:
    """The quantities of a table, which can be read out again of the same table with other values or uncertainties."""

    table: Table
    quantities: list[Quantity]
    factors: list[tuple[Geometry, np.ndarray]]
    shares: list[Share]
    notes: list[str]
    base: Readout
    """Of the table as it is."""
    albedos: SidedAlbedos
    standards: TableStandards
    feature_width: float = 0.0
    """Radians: no lobe is narrower."""
    turned: float | None = None
    """See `azimuth_dependence`: what light from all sides gives is then not known."""

    @classmethod
    def of(
        cls,
        table: Table,
        geometries: Sequence[str] = (),
        entries: Sequence[StandardQuantity] = (),
        feature_width: float = 0.0,
    ) -> "TableMeasurands":
        """The quantities of a table that can be computed: albedos, reflectance factors at `NAMED` and `geometries`, and
        those of standards.

        Of geometries that were not read a grid gives an interpolated value with a bound. Raises GonioError for such a
        one with the light behind the sample.
        """
        albedos = once(table, ("albedos", feature_width), lambda: albedos_by_side(table, feature_width))
        shares, notes = _shares(albedos)
        (factors, between), nothing = _factors(table, geometries), np.zeros(0)
        entries = [*[g.between() for g in between], *entries]
        turned = once(table, "turned", lambda: azimuth_dependence(table))
        standards = TableStandards.of(table, entries, albedos, feature_width, turned)
        standards = standards.with_reasons({g.text: _nearest(table, g) for g in between})
        empty = Readout(nothing, nothing, nothing)
        made = cls(table, [], factors, shares, notes, empty, albedos, standards, feature_width, turned)
        base, labels = made._parts(table, albedos), made._labels()
        rows = [
            Quantity(
                *label[:3], float(v), float(b), label[3], unit, STANDARDS.get(label[0], ""), group=group, u=float(u)
            )
            for (label, group, unit), v, b, u in zip(labels, *base, strict=True)
        ]
        named = standards.rows
        columns = zip(base, zip(*((q.value, q.bound, q.u) for q in named), strict=True), strict=True) if named else ()
        base = Readout(*(np.concatenate(pair) for pair in columns)) if named else base
        return dataclasses.replace(made, quantities=rows + named, base=base)

    def read_out(self, table: Table) -> Readout:
        """Values, bounds and noise of all quantities, of the same table with other f or u_f."""
        albedos = albedos_by_side(table, self.feature_width) if self.shares else self.albedos
        parts = self._parts(table, albedos), self.standards.read_out(table, albedos)
        return Readout(*(np.concatenate(pair) for pair in zip(*parts, strict=True)))

    def scaled(self, table: Table, share: float | np.ndarray) -> np.ndarray:
        """Change (Q,) of all quantities where the readings of each channel grow by a share, () or (C,)."""
        if not np.any(share):
            return np.zeros(self.base.values.size)
        grown = dataclasses.replace(table, f=np.asarray(table.f[...], float) * (1 + share))
        albedos = {
            sides: known if isinstance(known, str) else dataclasses.replace(known, value=known.value * (1 + share))
            for sides, known in self.albedos.items()
        }
        parts = self._parts(grown, albedos).values, self.standards.read_out(grown, albedos)[0]
        return np.concatenate(parts) - self.base.values

    def _parts(self, table: Table, albedos: SidedAlbedos) -> Readout:
        parts = []
        for share in self.shares:
            known = albedos[share.sides]
            assert not isinstance(known, str)
            value, bound, noise = _of_share(known, share)
            parts.append(Readout(value.ravel(), bound.ravel(), noise.ravel()))
            uniform = _uniform_light(known.theta_i[share.whole], value, bound, noise)
            if self.turned is not None:
                uniform = uniform._replace(bounds=np.full(uniform.bounds.shape, np.inf))
            parts += [uniform] * (2 if share.sides == FRONT_TO_FRONT else 1)
        for both in _both_ways(self.shares, albedos):
            parts.append(_absorbed(*both))
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

    def _labels(self) -> "list[tuple[Label, str, str]]":
        """What each quantity is called, its group and its unit, in the order of `_parts`."""
        names, labels = self.table.channels.names, []
        for share in self.shares:
            known = self.albedos[share.sides]
            assert not isinstance(known, str)
            group = "transmission" if share.through else "albedo"
            name, uniform = (TRANSMITTANCE, UNIFORM_THROUGH) if share.through else (ALBEDO, UNIFORM)
            labels += [(label, group, "1") for label in _incidences(name, known, share.whole, share.sides[0], names)]
            behind = "" if share.sides[0] > 0 else "lit from behind"
            labels += [((uniform, behind, c, {}), group, "1") for c in names]
            if share.sides == FRONT_TO_FRONT:
                labels += [((BHR, WHITE_SKY, c, {}), "remote sensing", "1") for c in names]
        for (known, whole), _ in _both_ways(self.shares, self.albedos):
            rows = _incidences(ABSORPTANCE, known, whole, 1, names)
            labels += [(label, "transmission", "1") for label in rows]
        for g, _ in self.factors:
            angles = {"theta_i": math.degrees(g.theta_i), "theta_o": math.degrees(g.theta_o)}
            angles |= {} if g.delta_phi is None else {"delta_phi": math.degrees(g.delta_phi)}
            name = THROUGH_FACTOR if g.through else FACTOR
            group = "transmission" if g.through else "reflectance"
            labels += [((name, g.text, c, {k: round(v, 9) for k, v in angles.items()}), group, "1") for c in names]
        return labels


Label = tuple[str, str, str, dict[str, float]]
"""Name, place, channel, angles in degrees."""


def _shares(albedos: SidedAlbedos) -> tuple[list[Share], list[str]]:
    """The sides of which there are albedos, and remarks on what there is none of."""
    shares, notes = [], []
    for sides, known in albedos.items():
        what = TRANSMITTANCE if sides[0] != sides[1] else ALBEDO
        if isinstance(known, str):
            if sides != FRONT_TO_FRONT:  # whose albedos are listed as undecided
                side = "" if sides[0] > 0 else " of light from behind"
                notes.append(f"There is no {what}{side}: {known}.")
            continue
        whole = ~known.partial & np.isfinite(known.value).all(axis=1)
        if whole.any():
            shares.append(Share(sides, whole))
        if not whole.all():
            unread = ", ".join(f"{t:.4g}°" for t in np.unique(np.degrees(known.theta_i[~whole]).round(6)))
            notes.append(f"There is no {what} at θi {unread}: too little of the hemisphere was read.")
    return shares, notes


def _of_share(known: Albedos, share: Share) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, bounds and noise (n, C) of the incidences that have an albedo."""
    value, noise = known.value[share.whole], known.noise[share.whole]
    return value, np.maximum(known.above, known.below)[share.whole] - STANDARD_UNCERTAINTIES * noise, noise


def _incidences(name: str, known: Albedos, whole: np.ndarray, light: int, channels: Sequence[str]) -> list[Label]:
    theta, phi = (np.degrees(a[whole]).round(9).tolist() for a in (known.theta_i, known.phi_i))
    turned, labels = len({p for t, p in zip(theta, phi, strict=True) if t > AT_NORMAL}) > 1, []
    for t, p in zip(theta, phi, strict=True):
        t = t if light > 0 else 180.0 - t
        place = f"θi {t:.4g}°" + (f", φi {p:.4g}°" if turned else "")
        labels += [(name, place, c, {"theta_i": t} | ({"phi_i": p} if turned else {})) for c in channels]
    return labels


WithWhole = tuple[Albedos, np.ndarray]


def _both_ways(shares: list[Share], albedos: SidedAlbedos) -> list[tuple[WithWhole, WithWhole]]:
    """(reflectance, transmittance) of light in front where both have the same incidences, each with those that are
    whole in both."""
    whole = {s.sides: s.whole for s in shares}
    r, t = (albedos.get(sides, "") for sides in ((1, 1), (1, -1)))
    if isinstance(r, str) or isinstance(t, str) or not {(1, 1), (1, -1)} <= whole.keys():
        return []
    same = r.theta_i.shape == t.theta_i.shape and np.allclose(
        [r.theta_i, r.phi_i], [t.theta_i, t.phi_i], rtol=0, atol=1e-6
    )
    both = whole[1, 1] & whole[1, -1] if same else np.zeros(0, bool)
    return [((r, both), (t, both))] if both.any() else []


def _absorbed(r: WithWhole, t: WithWhole) -> Readout:
    """What is neither reflected nor transmitted."""
    (a, b, n), (c, d, m) = (_of_share(known, Share((1, 1), whole)) for known, whole in (r, t))
    return Readout((1 - a - c).ravel(), (b + d).ravel(), np.hypot(n, m).ravel())


def _factors(table: Table, geometries: Sequence[str]) -> tuple[list[tuple[Geometry, np.ndarray]], list[Geometry]]:
    """Geometries with the cells that were read there, and those that are wanted and were not read."""
    factors: list[tuple[Geometry, np.ndarray]] = []
    between: list[Geometry] = []
    for text in dict.fromkeys([*NAMED, *THROUGH, *geometries]):
        geometry = Geometry.of(text)
        cells = geometry.cells(table)
        if cells.size:
            factors.append((geometry, cells))
        elif text in geometries and geometry.theta_i < math.pi / 2:
            between.append(geometry)
        elif text in geometries:
            raise GonioError(
                f"nothing was read at {text} (within {math.degrees(SAME):g}°); {_nearest(table, geometry)}"
            )
    return factors, between


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
