"""How far interpolation between the nodes of a grid may be off, by what the readings around show."""

import math
from collections.abc import Mapping

import numpy as np

from gonio.checks.grid_resolution import LARGEST
from gonio.checks.table.energy import mirror_reach
from gonio.data.interpolation.grid_boxes import GridBoxes
from gonio.data.interpolation.grid_coordinates import layout_coordinates
from gonio.data.interpolation.multilinear import AT_NODE
from gonio.data.table import COPIED, Table
from gonio.metrology.standards.apertures import Rule
from gonio.metrology.standards.bends import COVERAGE, Bend, Bends, curvatures
from gonio.metrology.standards.of_tables import FLOOR, WITHIN, Part, following
from gonio.metrology.standards.reflectance import NEAR_LIGHT
from gonio.metrology.values.filled_cells import FilledCells, filled_cells
from gonio.metrology.values.uncertain_part import RECTANGULAR, Uncertain
from gonio.models.geometry.directions import Direction

ROWS = 20_000
"""Pairs of directions at once."""


class NodeUncertainty:
    """Of a part of a table on a grid, both directions mirrored into the front hemisphere."""

    def __init__(self, table: Table, reflects: bool) -> None:
        self.part = Part(table, np.arange(table.layout.size), (), mirror_reach(table, 0.0))
        self.bends = Bends.of(table.layout, self.part.f, self.part.u)
        self.reflects = reflects

    def of(self, wi: Direction, wo: Direction, f: np.ndarray) -> Uncertain:
        """That of pairs of directions (n,), which the grid covers, at which the interpolated values are f (n, C)."""
        parts = []
        for start in range(0, max(wi.z.size, 1), ROWS):
            i, o = (Direction(*(c[start : start + ROWS] for c in w)) for w in (wi, wo))
            parts.append(self._of(i, o, f[start : start + ROWS]))
        return Uncertain(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _of(self, wi: Direction, wo: Direction, f: np.ndarray) -> Uncertain:
        boxes, x = self._boxes(wi, wo)
        of_valid = boxes.of_valid(self.part.valid)
        bound = self._bent(of_valid, x) + self._missing(boxes, f[boxes.order])
        bound += np.abs(self._interpolated(wi, wo) - self._moved(wi, wo))[boxes.order]
        bound[self._unseen(boxes, wi, wo)] = np.inf
        back = np.argsort(boxes.order)
        return Uncertain(self._noise(of_valid)[back], bound[back] / RECTANGULAR)

    def _boxes(self, wi: Direction, wo: Direction) -> tuple[GridBoxes, Mapping[str, np.ndarray]]:
        layout = self.part.table.layout
        x, _ = layout_coordinates(layout, wi, wo)
        return GridBoxes.of(layout, self.part.axes, x), x

    def _filled(self, boxes: GridBoxes) -> FilledCells:
        """f at the corners of boxes (corners, B, C), those without a reading by the readings beside them."""
        cells, place = np.unique(boxes.cells, return_inverse=True)
        made = filled_cells(self.part.table.layout, self.part.f, cells)
        return FilledCells(*(a[place.reshape(boxes.cells.shape)] for a in made))

    def _missing(self, boxes: GridBoxes, f: np.ndarray) -> np.ndarray:
        """What f (n, C), in the order of the boxes, may be off by as corners have no reading; infinite where no other
        tells what there would be."""
        if self.part.valid.all():
            return np.zeros(f.shape)
        made, missing = self._filled(boxes)
        unknown = boxes.interpolated(np.isnan(made).astype(float)) > AT_NODE
        off = np.abs(f - boxes.interpolated(np.nan_to_num(made)))
        return np.where(unknown, np.inf, off + boxes.interpolated(missing))

    def _noise(self, boxes: GridBoxes) -> np.ndarray:
        u = self.part.u[boxes.cells]
        if COPIED in self.part.table.provenance:
            return boxes.interpolated(u)
        return np.sqrt(_squared(boxes).interpolated(u**2))

    def _bent(self, boxes: GridBoxes, x: Mapping[str, np.ndarray]) -> np.ndarray:
        """What f may be off by as it is bent between its nodes (n, C), in the order of the boxes.

        By its curvature at the nodes, as it is and as that of its logarithm, beyond the noise, and by what noise hides.
        """
        layout = self.part.table.layout
        cells, place = np.unique(boxes.cells, return_inverse=True)
        place = place.reshape(boxes.cells.shape)
        here = np.nan_to_num(self.part.f[cells])
        floor = np.maximum(FLOOR * np.maximum(np.abs(here), FLOOR * np.max(np.abs(here), axis=0)), 1e-300)
        shown = boxes.interpolated(np.maximum(here, floor)[place])
        by_slope, by_share, inside, hidden = (np.zeros(shown.shape) for _ in range(4))
        squared = _squared(boxes)
        for k, curved in enumerate(curvatures(layout, boxes, x)):
            bend = self.bends.along(k, cells, floor)
            slope, share = (boxes.interpolated(error[place]) for error in bend.beyond_noise())
            by_slope += curved[:, None] * slope
            by_share += curved[:, None] * share
            noise = bend.noise()
            within = np.clip(np.nan_to_num(bend.straight()), -noise, noise)
            inside += curved[:, None] * boxes.interpolated(within[place])
            hidden += curved[:, None] * np.sqrt(squared.interpolated(_spread(bend)[place] ** 2))
        missed = np.maximum(by_slope, shown * np.expm1(np.minimum(by_share, LARGEST)))
        return WITHIN * missed + np.abs(inside) + COVERAGE * hidden

    def _moved(self, wi: Direction, wo: Direction) -> np.ndarray:
        """f (n, C) where it goes along with the mirror direction from one incidence to the next."""
        layout, n = self.part.table.layout, wi.z.size
        if not ({"theta_i", "theta_o"} <= layout.axes.keys() and layout.axes["theta_i"].size > 1):
            return self._interpolated(wi, wo)
        rule = following(Rule(wi, wo, np.ones(n)), np.sort(np.abs(layout.axes["theta_i"])))
        f = rule.weight[:, None] * self._interpolated(rule.wi, rule.wo)
        return f[:n] + f[n:]

    def _interpolated(self, wi: Direction, wo: Direction) -> np.ndarray:
        boxes, _ = self._boxes(wi, wo)
        f = np.empty((wi.z.size, self.part.f.shape[1]))
        f[boxes.order] = boxes.interpolated(np.nan_to_num(self._filled(boxes).f))
        return f

    def _unseen(self, boxes: GridBoxes, wi: Direction, wo: Direction) -> np.ndarray:
        """Where a lobe about the mirror direction, or back to the light, may hide that no reading around has seen."""
        unseen = np.zeros(boxes.order.size, bool)
        cells, place = np.unique(boxes.cells, return_inverse=True)
        read, place = self.part.table.layout.directions_at(cells), place.reshape(boxes.cells.shape)
        wi, wo = (Direction(*(c[boxes.order] for c in w)) for w in (wi, wo))
        for sign in (1.0, -1.0) if self.reflects else (1.0,):
            away = _angle(wi, wo, sign)
            of_cells = np.where(self.part.valid[cells], _angle(*read, sign), np.inf)
            of_boxes = np.repeat(np.min(of_cells[place], axis=0), np.diff(boxes.starts))
            hides = (away < of_boxes) & (of_boxes > self.part.reach)
            unseen |= hides if sign > 0 else hides & (away < math.radians(NEAR_LIGHT))
        return unseen


def _angle(wi: Direction, wo: Direction, sign: float) -> np.ndarray:
    """Angle (n,) of wo from the mirror direction of wi (sign 1), or from wi (−1)."""
    cosine = wo.z * wi.z - sign * (wo.x * wi.x + wo.y * wi.y)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _squared(boxes: GridBoxes) -> GridBoxes:
    """With the squares of the weights: variances of independent readings are interpolated by them."""
    return boxes._replace(weight=boxes.weight**2)


def _spread(bend: Bend) -> np.ndarray:
    """Standard uncertainty (cells, C) of `Bend.straight` by the readings' own."""
    size = np.sqrt(1 + bend.t**2 + (1 - bend.t) ** 2)
    return bend.scale[:, None] * size[:, None] * bend.u
