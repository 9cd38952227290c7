"""Integrals of a table's readings: of a grid by interpolation, with a bound on what lies between its nodes.

Each integral is a sum of readings with fixed weights, so that other readings of the same cells, moved by an error or
with other noise, give it again at no cost.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gonio.checks.albedos import Albedos
from gonio.checks.grid_resolution import LARGEST
from gonio.checks.table.energy import STANDARD_UNCERTAINTIES, mirror_reach
from gonio.data.flags import Flag
from gonio.data.interpolation.coverage import on_grid
from gonio.data.interpolation.grid_boxes import GridBoxes, interpolation_axes
from gonio.data.interpolation.grid_coordinates import layout_coordinates
from gonio.data.interpolation.multilinear import InterpolationAxis
from gonio.data.table import Table
from gonio.metrology.standards.apertures import Rule, joined
from gonio.metrology.standards.bends import Bends, curvatures
from gonio.metrology.standards.evaluation import Integrals
from gonio.metrology.standards.shared import once
from gonio.metrology.standards.standard import Aperture, Hemisphere, Integral
from gonio.models.display import percent
from gonio.models.geometry.directions import Direction

SAME = math.radians(0.1)
"""A direction was read where a reading is so near."""
BEYOND = 0.5
"""Steps of a grid within its innermost polar angle that interpolation reaches."""
FLOOR = 1e-3
"""Share of the mean f of an integral below which no structure is looked for."""
WITHIN = 2.0
"""How much more f may be bent within a cell than at its nodes: of GGX lobes of two steps' width up to 1.7 times."""
UNSEEN = (
    "the mirror direction was not read, where a lobe narrower than the grid may hide; read it, or state the narrowest "
    "feature (--feature-width)"
)
PIECE = 4096
"""Nodes of a rule whose errors are computed at once: they stay in the processor's cache."""
NO_GRID = "the readings are on no grid: a fit of them has it (gonio fit, then gonio quantities FIT.toml)"
ONE_AZIMUTH = (
    "the light had one azimuth, and at normal incidence f depends on the detector's by {size}: the surface is not "
    "isotropic; read it with the light at other azimuths, or the exchanged geometry"
)
SidedAlbedos = Mapping[tuple[int, int], Albedos | str]


class Row(NamedTuple):
    """Numbers of cells of the table and the weights of their readings; `bound` (C,) on what lies between them."""

    cells: np.ndarray
    weight: np.ndarray
    bound: np.ndarray


class Incidences(NamedTuple):
    """Sides, numbers of albedos and their weights; `bend` (C,): bound of what lies between the incidences."""

    sides: tuple[int, int]
    numbers: np.ndarray
    weight: np.ndarray
    bend: np.ndarray


@dataclasses.dataclass(frozen=True)
class TableIntegrals:
    """J integrals of a table, each a `Row` or `Incidences`, or why it is not known."""

    rows: list[Row | Incidences | str]
    channels: int

    @classmethod
    def of(
        cls,
        table: Table,
        integrals: Sequence[Integral],
        albedos: SidedAlbedos,
        feature_width: float = 0.0,
        turned: float | None = None,
    ) -> "TableIntegrals":
        """Those of a table, whose albedos are known; no lobe is narrower than `feature_width`, radians.

        `turned`: see `azimuth_dependence`.
        """
        rows: dict[Integral, Row | Incidences | str] = {}
        for detector in (1, -1):
            there = [i for i in integrals if isinstance(i, Aperture) and detector * float(i.fine.wo.z[0]) > 0]
            rows |= _rows(table, detector, there, feature_width) if there else {}
        rows |= {i: _incidences(i, albedos) for i in integrals if isinstance(i, Hemisphere)}
        if turned is not None:
            around = [i for i in integrals if isinstance(i, Aperture) and i.around]
            rows |= dict.fromkeys(around, ONE_AZIMUTH.format(size=percent(turned)))
        return cls([rows[i] for i in integrals], len(table.channels))

    def known(self, table: Table, albedos: SidedAlbedos) -> Integrals:
        """Values and bounds of the same cells of a table with these or other readings."""
        values, bounds = (np.zeros((len(self.rows), self.channels)) for _ in range(2))
        unknown = {}
        for j, row in enumerate(self.rows):
            if isinstance(row, str):
                unknown[j] = row
            elif isinstance(row, Row):
                f = np.nan_to_num(np.asarray(table.values_at(row.cells)["f"], float))
                values[j], bounds[j] = row.weight @ f, row.bound
            else:
                known = albedos[row.sides]
                assert not isinstance(known, str)
                bound = np.maximum(known.above, known.below) - STANDARD_UNCERTAINTIES * known.noise
                values[j] = row.weight @ known.value[row.numbers]
                bounds[j] = row.weight @ bound[row.numbers] + row.bend
        return Integrals(values, bounds, unknown)

    def noise(self, table: Table, albedos: SidedAlbedos, numbers: Sequence[int], by: np.ndarray) -> np.ndarray:
        """Standard uncertainty (C,) by `u_f` of a sum of some integrals with slopes (J, C); albedos as independent."""
        variance = np.zeros(self.channels)
        cells, weights = [], []
        for slope, j in zip(by, numbers, strict=True):
            row = self.rows[j]
            if isinstance(row, Row):
                cells.append(row.cells)
                weights.append(row.weight[:, None] * slope)
            elif isinstance(row, Incidences):
                known = albedos[row.sides]
                assert not isinstance(known, str)
                variance += np.sum((row.weight[:, None] * slope * known.noise[row.numbers]) ** 2, axis=0)
        if cells:
            which, place = np.unique(np.concatenate(cells), return_inverse=True)
            total = np.zeros((which.size, self.channels))
            np.add.at(total, place, np.concatenate(weights))
            u = np.nan_to_num(np.asarray(table.values_at(which)["u_f"], float))
            variance += np.sum((total * u) ** 2, axis=0)
        return np.sqrt(variance)


def _incidences(integral: Hemisphere, albedos: SidedAlbedos) -> Incidences | str:
    """The incidences whose albedos make that of one angle: itself, or both beside it."""
    sides = (1, -1 if integral.behind else 1)
    known = albedos.get(sides, "that side of the sample was not read")
    if isinstance(known, str):
        return f"there is no integral over the hemisphere: {known}"
    nearest = known.phi_i[np.argmin(np.abs(np.mod(known.phi_i + 1e-9, 2 * np.pi)))]
    usable = ~known.partial & np.isfinite(known.value).all(axis=1) & np.isfinite(known.above).all(axis=1)
    usable &= (np.abs(known.phi_i - nearest) < 1e-9) | (known.theta_i < 1e-9)
    numbers = np.flatnonzero(usable)
    numbers = numbers[np.argsort(known.theta_i[numbers])]
    theta, nothing = known.theta_i[numbers], np.zeros(known.value.shape[1])
    if theta.size and np.min(np.abs(theta - integral.theta_i)) < SAME:
        k = int(np.argmin(np.abs(theta - integral.theta_i)))
        return Incidences(sides, numbers[k : k + 1], np.ones(1), nothing)
    high = int(np.searchsorted(theta, integral.theta_i))
    if not 0 < high < theta.size:
        angle = f"at θi {math.degrees(integral.theta_i):.4g}°, nor on both sides of it"
        if known.unseen.any():
            return f"{UNSEEN} {angle}"
        return f"there is no albedo {angle}"
    t = (integral.theta_i - theta[high - 1]) / (theta[high] - theta[high - 1])
    value = known.value[numbers]
    bends = [_bend(theta, value, k) for k in (high - 1, high) if 0 < k < theta.size - 1]
    bend = np.max(bends, axis=0) if bends else np.abs(value[high] - value[high - 1])
    return Incidences(sides, numbers[high - 1 : high + 1], np.array([1 - t, t]), t * (1 - t) * bend)


def _rows(
    table: Table, detector: int, integrals: list[Aperture], feature_width: float
) -> dict[Integral, Row | Incidences | str]:
    """Rows of integrals over apertures on one side, or why there are none."""
    rows: dict[tuple, Row | Incidences | str] = once(table, ("rows", detector, feature_width), dict)
    names = {i: _content(i) for i in integrals}
    missing = [i for i in integrals if names[i] not in rows]
    if missing:
        part = Part.of(table, detector, feature_width)
        made = part if isinstance(part, str) else part.rows(missing)
        rows |= {names[i]: made if isinstance(made, str) else made[i] for i in missing}
    return {i: rows[names[i]] for i in integrals}


def _content(integral: Aperture) -> tuple:
    """Equal for integrals whose rows are."""
    parts = (
        b"" if rule is None else b"".join(np.asarray(a, float).tobytes() for a in (*rule.wi, *rule.wo, rule.weight))
        for rule in (integral.fine, integral.coarse)
    )
    return (*parts, integral.mirror, integral.moves, integral.back, integral.angles)


def following(rule: Rule, nodes: np.ndarray) -> Rule:
    """The same integral with the light at polar angles of a grid on both sides of its own, radians, which share it.

    The detector goes along with the mirror direction, so that a lobe about it is not smeared by the light's step.
    """
    wi, wo = rule.wi, rule.wo._replace(z=np.abs(rule.wo.z))
    theta, sine = np.arccos(np.clip(wi.z, -1.0, 1.0)), np.hypot(wi.x, wi.y)
    cos_phi, sin_phi = (np.where(sine > 0, c / np.maximum(sine, 1e-300), one) for c, one in ((wi.x, 1.0), (wi.y, 0.0)))
    k = np.clip(np.searchsorted(nodes, theta) - 1, 0, nodes.size - 2)
    t = np.clip((theta - nodes[k]) / (nodes[k + 1] - nodes[k]), 0.0, 1.0)
    parts = []
    for node, share in ((nodes[k], 1 - t), (nodes[k + 1], t)):
        light = Direction(np.sin(node) * cos_phi, np.sin(node) * sin_phi, np.cos(node))
        cosine, turn = np.cos(node - theta), np.sin(node - theta)
        ahead, across = -(wo.x * cos_phi + wo.y * sin_phi), wo.y * cos_phi - wo.x * sin_phi
        ahead, up = ahead * cosine + wo.z * turn, wo.z * cosine - ahead * turn
        there = Direction(-ahead * cos_phi - across * sin_phi, across * cos_phi - ahead * sin_phi, up)
        above = up > 1e-3
        parts.append(
            Rule(
                Direction(*(np.where(above, a, b) for a, b in zip(light, wi, strict=True))),
                Direction(*(np.where(above, a, b) for a, b in zip(there, wo, strict=True))),
                rule.weight * share,
            )
        )
    return joined(parts)


def _bend(x: np.ndarray, values: np.ndarray, k: int) -> np.ndarray:
    """|value of a node − that by the line through its neighbours|, (C,)."""
    t = (x[k] - x[k - 1]) / (x[k + 1] - x[k - 1])
    return np.abs(values[k] - (1 - t) * values[k - 1] - t * values[k + 1])


@dataclasses.dataclass(frozen=True)
class Part:
    """The readings of light in front and a detector on one side, directions mirrored into the front hemisphere."""

    table: Table
    numbers: np.ndarray
    """Of its cells in the whole table."""
    angles: tuple[np.ndarray, ...]
    """theta_i, phi_i, theta_o, phi_o of its cells; nothing of half vectors, whose cells nobody names by them."""
    reach: float

    @functools.cached_property
    def f(self) -> np.ndarray:
        """f (cells, C), NaN where it is not valid."""
        f, flag = (np.asarray(a[...]).reshape(self.table.layout.size, -1) for a in (self.table.f, self.table.flag))
        return np.where(flag == Flag.VALID, f.astype(float), np.nan)

    @functools.cached_property
    def u(self) -> np.ndarray:
        """Standard uncertainties (cells, C), 0 where they are not known."""
        if self.table.u_f is None:
            return np.zeros(self.f.shape)
        return np.nan_to_num(np.asarray(self.table.u_f[...], float).reshape(self.f.shape))

    @functools.cached_property
    def axes(self) -> tuple[InterpolationAxis, ...]:
        """Of the grid, as it is interpolated."""
        return interpolation_axes(self.table.layout)

    @functools.cached_property
    def valid(self) -> np.ndarray:
        """Which cells have a reading in all channels."""
        return np.asarray(np.isfinite(self.f).all(axis=1))

    @classmethod
    def of(cls, table: Table, detector: int, feature_width: float) -> "Part | str":
        """That of a table; or why there is none."""
        if table.interpolant is not None:
            return "its format reads it by a rule of its own, which bounds no integral over an aperture"
        part, numbers = table.parts().get((1, detector)), np.arange(table.layout.size)
        if part is None or not part.valid_cells().size:
            return f"nothing was read {'in front of' if detector > 0 else 'behind'} the sample with light in front"
        if part is not table:
            numbers = numbers.reshape(table.layout.shape)[table.layout.folded(1, detector)[1]].ravel()
        angles = () if part.layout.in_half_vectors else tuple(np.asarray(a) for a in part.layout.angles())
        return cls(part, numbers, angles, mirror_reach(table, feature_width))

    def rows(self, integrals: Sequence[Aperture]) -> dict[Integral, Row | Incidences | str]:
        """The cells and weights of integrals; or why they are not known."""
        made: dict[Integral, Row | Incidences | str] = {}
        for integral in integrals:
            if integral.angles is not None and (cells := self._read_at(*integral.angles)).size:
                weight = np.full(cells.size, integral.fine.weight[0] / cells.size)
                made[integral] = Row(self.numbers[cells], weight, np.zeros(len(self.table.channels)))
        between = [i for i in integrals if i not in made]
        if not self.table.layout.gridded:
            return made | dict.fromkeys(between, NO_GRID)
        rules = [self._rules(i) for i in between]
        places = iter(self._places([r for of_one in rules for r in of_one]))
        for integral, of_one in zip(between, rules, strict=True):
            first, *others = [next(places) for _ in of_one]
            # What lies between the nodes is bounded once: other ways show by how much their sums differ.
            gathered = [self._bounded(first, integral.mirror, integral.back), *map(self._weighted, others)]
            failed = next((r for r in gathered[: 1 if integral.coarse is None else 2] if isinstance(r, str)), None)
            usable, moves = [r for r in gathered if isinstance(r, Row)], integral.mirror or integral.moves
            made[integral] = self._joined(usable, -1 if moves else 0) if failed is None else failed
        return made

    def _rules(self, integral: Aperture) -> list[Rule]:
        """The integral, the same by fewer nodes, and with the light at the nodes of the grid, as a lobe moves."""
        layout, fine = self.table.layout, integral.fine
        between = {"theta_i", "theta_o"} <= layout.axes.keys() and layout.axes["theta_i"].size > 1
        nodes = [following(fine, np.sort(np.abs(layout.axes["theta_i"])))] if between else []
        return [fine, *([] if integral.coarse is None else [integral.coarse]), *nodes]

    def _joined(self, ways: list[Row], number: int) -> Row:
        """One of several ways to compute an integral, by its number; their differences are in the bound of the first.

        Between two incidences f may stay as it is, or go along with the mirror direction: their difference shows how
        far apart the incidences are for this f.
        """
        sums = [r.weight @ np.nan_to_num(self.f[r.cells]) for r in ways]
        bound = ways[0].bound + sum((np.abs(sums[0] - s) for s in sums[1:]), np.zeros(sums[0].size))
        best = ways[number]
        return Row(self.numbers[best.cells], best.weight, bound)

    def _places(self, rules: list[Rule]) -> "list[Places]":
        if not rules:
            return []
        whole = joined(rules)
        x, inside_layout = layout_coordinates(self.table.layout, whole.wi, whole.wo._replace(z=np.abs(whole.wo.z)))
        inside = on_grid(self.table, x, inside_layout, BEYOND)
        for name in ("theta_i", "theta_o", "theta_h", "theta_d"):
            if name in x and self.table.layout.axes[name].size > 1:
                inside &= np.abs(x[name]) <= np.max(np.abs(self.table.layout.axes[name])) + 1e-9
        ends = np.cumsum([r.weight.size for r in rules])[:-1]
        parts = [np.split(a, ends) for a in (whole.weight, inside, *x.values())]
        return [
            Places(weight, there, dict(zip(x, angles, strict=True)))
            for weight, there, *angles in zip(*parts, strict=True)
        ]

    def _read_at(self, theta_i: float, theta_o: float, turn: float) -> np.ndarray:
        """Cells that are valid in all channels and were read at one pair of directions."""
        if not self.angles:
            return np.zeros(0, int)
        i, phi_i, o, phi_o = self.angles
        off = np.abs(np.mod(phi_o - phi_i - turn + np.pi, 2 * np.pi) - np.pi)
        here = (np.abs(i - theta_i) < SAME) & (np.abs(o - theta_o) < SAME)
        cells = np.flatnonzero(here & (off * np.minimum(np.sin(i), np.sin(o)) < SAME))
        return cells[np.isfinite(self.f[cells]).all(axis=1)]

    def _weighted(self, rule: "Places") -> Row | str:
        """The weights of the part's cells by multilinear interpolation, without a bound."""
        gathered = self._gathered(rule)
        if isinstance(gathered, str):
            return gathered
        return Row(gathered.cells, gathered.weight, np.zeros(len(self.table.channels)))

    def _gathered(self, rule: "Places") -> "Gathered | str":
        """The cells about a rule's nodes, with what the nodes weigh there."""
        layout = self.table.layout
        if not rule.inside[rule.weight != 0].all():
            return self._unread(rule)
        boxes = GridBoxes.of(layout, self.axes, rule.angles).of_valid(self.valid)
        share, curved = rule.weight[boxes.order], curvatures(layout, boxes, rule.angles)
        cells, place = np.unique(boxes.cells, return_inverse=True)
        place = place.reshape(boxes.cells.shape)
        sums = boxes.summed(share[:, None] * np.stack([np.ones_like(share), *curved], axis=1))
        weight, *bent_by = (np.bincount(place.ravel(), a.ravel(), cells.size) for a in np.moveaxis(sums, -1, 0))
        return Gathered(boxes, share, curved, cells, place, weight, bent_by)

    def _bounded(self, rule: "Places", mirror: bool, back: bool) -> Row | str:
        """The weights of the part's cells by multilinear interpolation, with the bound on what it may be off by."""
        g = self._gathered(rule)
        if isinstance(g, str):
            return g
        if mirror and not self._reads(g.cells, -1.0):
            return UNSEEN
        if back and not self._reads(g.cells, 1.0):
            return "the light's own direction was not read, where a lobe back to it may hide"
        f = np.nan_to_num(self.f[g.cells])
        floor = np.maximum(FLOOR * np.abs(g.weight @ f) / max(float(np.sum(np.abs(rule.weight))), 1e-300), 1e-300)
        made, errors = Bends.of(self.table.layout, self.f, self.u), [np.maximum(f, floor)]
        for k, of_axis in enumerate(g.bent_by):
            bent = made.along(k, g.cells, floor)
            errors += bent.beyond_noise()
            made.add(bent, of_axis)
        missed = g.missed(np.concatenate(errors, axis=1)[g.place], f.shape[1])
        return Row(g.cells, g.weight, WITHIN * np.abs(g.share) @ missed + made.within_noise())

    def _unread(self, rule: "Places") -> str:
        if rule.weight.size == 1:
            return "that pair of directions was not read, nor does the grid reach it"
        if self.table.layout.in_one_plane:
            return "the readings are in one plane, and its apertures reach out of it"
        share = float(np.sum(np.abs(rule.weight[~rule.inside])) / np.sum(np.abs(rule.weight)))
        return f"{100 * share:.3g} % of its apertures were not read"

    def _reads(self, cells: np.ndarray, sign: float) -> bool:
        """Whether one of the cells has the detector in the mirror direction (−1), or where the light is (1)."""
        wi, wo = self.table.layout.directions_at(cells)
        cosine = wo.z * wi.z + sign * (wo.x * wi.x + wo.y * wi.y)
        return bool(np.max(cosine) >= math.cos(self.reach))


class Places(NamedTuple):
    """Weights of pairs of directions (n,), whether the grid answers there, and their angles by its axes."""

    weight: np.ndarray
    inside: np.ndarray
    angles: dict[str, np.ndarray]


class Gathered(NamedTuple):
    """The cells (N,) about n nodes of a rule: their weights, and those of what is bent along each axis (N,).

    `boxes` of the grid hold the nodes, in whose order `share` (n,) are their weights and `curved` the factors by which
    curvatures along each axis make errors; `place` (corners, B) of the boxes' corners among the cells.
    """

    boxes: GridBoxes
    share: np.ndarray
    curved: list[np.ndarray]
    cells: np.ndarray
    place: np.ndarray
    weight: np.ndarray
    bent_by: list[np.ndarray]

    def missed(self, errors: np.ndarray, channels: int) -> np.ndarray:
        """What lies between the cells at each node (n, C), by f and its bends along axes at corners (corners, B, m)."""
        missed = np.empty((self.share.size, channels))
        for of_boxes, these, boxes in self.boxes.pieces(PIECE):
            shown, *of_axes = np.split(boxes.interpolated(errors[:, of_boxes]), 1 + 2 * len(self.curved), axis=1)
            by_slope, by_share = (
                functools.reduce(
                    lambda total, term: np.add(total, term, out=total),
                    (c[these, None] * error for c, error in zip(self.curved, of_axes[kind::2], strict=True)),
                )
                for kind in (0, 1)
            )
            # What is bent between its nodes, and what may be a narrow peak there, as log f tells it.
            peaks = np.expm1(np.minimum(by_share, LARGEST, out=by_share), out=by_share)
            np.maximum(by_slope, np.multiply(shown, peaks, out=peaks), out=missed[these])
        return missed
