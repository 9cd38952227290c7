"""Where a table interpolates: the pairs of directions inside of the hull of what was read, without its holes."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.interpolation.grid_coordinates import layout_coordinates
from gonio.data.interpolation.multilinear import interpolation_axis
from gonio.data.layouts.base import Layout
from gonio.data.table import Table
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.geometry.low_discrepancy import low_discrepancy
from gonio.models.geometry.sides import FRONT

SAME = np.radians(1.0)
"""An angle this near to the only one that was read is that one."""
WIDEST_TURN = np.pi / 2
"""Gap between azimuths beyond which what lies between them was not read."""
AT_NODE = 1e-6
"""Radians from a node at which f was read there, however wide the gap beside it: angles are of single precision."""
KNOWN = 0.5
"""Weight of the cells with a value, of those that interpolation takes, from which on it interpolates."""
FAR = 2.0
"""Distance to the nearest reading over that of 95 % of the readings from their neighbours, beyond which is a hole."""
WIDEST = np.radians(15.0)
"""And never farther than that: a few readings all about do not tell what lies between them."""
LEAST_SHARE, LOOKED_AT = 0.5, 20_000
"""Of a file's directions, for which a table must have readings about it; directions that are looked at."""
FACETS, ROWS = 256, 4096
"""Of a hull, and pairs of directions, that are compared at once."""


def covered(table: Table, wi: Direction, wo: Direction, beyond: float = 0.0) -> np.ndarray:
    """Whether interpolation of a table between its readings answers for pairs of directions (n,).

    Args:
        table: any table; a format's own warp answers up to the largest incidence that it holds.
        wi, wo: unit directions with components of shape (n,).
        beyond: how far beyond the outermost nodes of a grid still counts, in its outermost steps.
    """
    wi, wo = (Direction(*(np.asarray(c, float) for c in w)) for w in (wi, wo))
    if table.interpolant is not None:
        return np.arccos(np.clip(wi.z, -1, 1)) <= np.max(table.layout.axes["theta_i"]) + SAME
    if table.sides == FRONT:
        return _in_part(table, wi, wo, beyond, True)
    inside = np.zeros(wi.z.shape, bool)
    upright = [w._replace(z=np.abs(w.z)) for w in (wi, wo)]
    for (light, detector), part in table.parts().items():
        here = np.flatnonzero((light * wi.z > 0) & (detector * wo.z > 0))
        if here.size and part.valid_cells().size:
            i, o = (Direction(*(c[here] for c in w)) for w in upright)
            inside[here] = _in_part(part, i, o, beyond, light == detector)
    return inside


def covers_angles(table: Table, angles: Sequence[np.ndarray]) -> np.ndarray:
    """The same of angles theta_i, phi_i, theta_o, phi_o, radians, of one shape, which the result has."""
    theta_i, phi_i, theta_o, phi_o = angles
    wi, wo = (from_spherical(t.ravel(), p.ravel(), np) for t, p in ((theta_i, phi_i), (theta_o, phi_o)))
    return covered(table, wi, wo).reshape(theta_i.shape)


def require_readings_about(table: Table, wi: Direction, wo: Direction) -> str:
    """What is to be said of how many of a file's pairs of directions (n,) a table has readings about.

    At `LOOKED_AT` of them at most, evenly chosen. Raises GonioError where it has about less than half.
    """
    n = np.size(wi.z)
    some = (low_discrepancy(LOOKED_AT, 1)[:, 0] * n).astype(int) if n > LOOKED_AT else np.arange(n)
    wi, wo = (Direction(*(np.asarray(c)[some] for c in w)) for w in (wi, wo))
    share = float(np.mean(covered(table, wi, wo)))
    if share < LEAST_SHARE:
        raise GonioError(
            f"{table.name or 'the table'} has readings about {percent(share)} of the directions that such a file "
            f"holds, expected {percent(LEAST_SHARE)} at least; fit a model to it and write that"
        )
    return f"{percent(1 - share)} of the directions have no reading: continued" if share < 0.995 else ""


def require_readings_on(table: Table, layout: Layout) -> str:
    """The same of the cells of a grid of one side."""
    cells = np.flatnonzero(layout.readable())
    return require_readings_about(table, *layout.directions_at(cells[:: max(1, cells.size // (4 * LOOKED_AT))]))


def _in_part(table: Table, wi: Direction, wo: Direction, beyond: float, reciprocal: bool) -> np.ndarray:
    """The same of one side of the sample."""
    if table.layout.gridded:
        return _on_grid(table, wi, wo, beyond)
    readings = ScatteredHull.of(table)
    inside = readings.contains(wi, wo)
    return inside | readings.contains(wo, wi) if reciprocal else inside


def _on_grid(table: Table, wi: Direction, wo: Direction, beyond: float) -> np.ndarray:
    return on_grid(table, *layout_coordinates(table.layout, wi, wo), beyond)


def on_grid(
    table: Table, coordinates: Mapping[str, np.ndarray], inside_layout: np.ndarray, beyond: float
) -> np.ndarray:
    """`covered` of a grid of one side, by what `layout_coordinates` gives."""
    layout, inside = table.layout, inside_layout.copy()
    for name, x in coordinates.items():
        if name in layout.axes:
            inside &= _between_nodes(layout, name, x, beyond)
    stored = hasattr(table.flag, "numbers")  # `StoredCells`
    valid = None if stored else (np.asarray(table.flag[...]) == Flag.VALID).any(axis=-1)
    if valid is not None and valid.all():
        return inside
    brackets = [interpolation_axis(layout, name).bracket(coordinates[name], np) for name in layout.axes]
    known = np.zeros(inside_layout.shape)
    for corner in np.ndindex(*[2] * len(brackets)):
        index = tuple(nodes[side] for (nodes, _), side in zip(brackets, corner, strict=True))
        there = (table.flag[index] == Flag.VALID).any(axis=-1) if valid is None else valid[index]
        share = there.astype(float)
        for (_, weights), side in zip(brackets, corner, strict=True):
            share *= weights[side]
        known += share
    return inside & (known >= KNOWN)


def _between_nodes(layout: Layout, name: str, x: np.ndarray, beyond: float) -> np.ndarray:
    nodes, period = layout.axes[name], layout.periods[name]
    if nodes.size == 1:
        # One azimuth of the light stands for all: the surface is taken as isotropic.
        return np.full(x.shape, True) if name in layout.turning_axes[:1] else np.abs(x - nodes[0]) <= SAME
    if name in layout.mirrored_axes:
        x = np.minimum(x, 2 * np.pi - x)
    steps = np.diff(nodes)
    if period is not None:
        steps, x = (
            np.append(steps, nodes[0] + period - nodes[-1]),
            nodes[0] - AT_NODE + np.mod(x - nodes[0] + AT_NODE, period),
        )
    first, last = (0.0, 0.0) if period is not None else (beyond * steps[0], beyond * steps[-1])
    end = nodes[-1] + (steps[-1] if period is not None else last)
    inside = (x >= nodes[0] - first - AT_NODE) & (x <= end + AT_NODE)
    if period is None and name not in layout.mirrored_axes:
        return inside
    low = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, steps.size - 1)
    read = np.minimum(np.abs(x - nodes[low]), np.abs(x - nodes[(low + 1) % nodes.size])) <= AT_NODE
    return inside & (read | (steps[low] <= WIDEST_TURN + 1e-9))


class ScatteredHull(NamedTuple):
    """The convex hull of scattered readings in their angles, and how near to one another they are."""

    centre: np.ndarray
    across: np.ndarray
    """(k, flat): directions in which the readings do not spread."""
    along: np.ndarray
    """(k, spread): those in which they do."""
    facets: np.ndarray
    """(m, spread + 1): outward normals and offsets."""
    points: np.ndarray
    reach: float
    isotropic: bool

    @classmethod
    def of(cls, table: Table) -> "ScatteredHull":
        """That of the readings of a table that are valid in any channel."""
        from scipy.spatial import ConvexHull, KDTree

        block = table.samples()
        phi = np.arctan2(block.wi.y, block.wi.x)[np.hypot(block.wi.x, block.wi.y) > 1e-9]
        isotropic = phi.size == 0 or bool(np.ptp(np.cos(phi)) < 1e-9 and np.ptp(np.sin(phi)) < 1e-9)
        points = np.unique(np.round(_points(block.wi, block.wo, isotropic), 9), axis=0)
        centre = points.mean(axis=0)
        offset = points - centre
        _, _, axes = np.linalg.svd(offset.T @ offset)
        place = offset @ axes.T
        flat = np.ptp(place, axis=0) <= SAME
        spread = place[:, ~flat]
        if spread.shape[1] == 0:
            facets = np.zeros((0, 1))
        elif spread.shape[1] == 1:
            facets = np.array([[1.0, -spread.max()], [-1.0, spread.min()]])
        else:
            facets = ConvexHull(spread, qhull_options="QJ").equations
        reach = SAME
        if len(points) > 1:
            spacing = float(np.quantile(KDTree(points).query(points, 2)[0][:, 1], 0.95))
            reach = float(np.clip(FAR * spacing, SAME, WIDEST))
        return cls(centre, axes.T[:, flat], axes.T[:, ~flat], facets, points, reach, isotropic)

    def contains(self, wi: Direction, wo: Direction) -> np.ndarray:
        """Whether pairs of directions (n,) lie in the hull, and near to a reading."""
        from scipy.spatial import KDTree

        points = _points(wi, wo, self.isotropic)
        offset = points - self.centre
        inside = (np.abs(offset @ self.across) <= SAME).all(axis=1)
        here = np.flatnonzero(inside)
        near = KDTree(self.points).query(points[here], distance_upper_bound=self.reach * (1 + 1e-12))[0]
        here = here[np.isfinite(near)]
        inside = np.zeros(len(points), bool)
        for start in range(0, here.size, ROWS):
            rows = here[start : start + ROWS]
            for facet in range(0, len(self.facets), FACETS):
                part = self.facets[facet : facet + FACETS]
                rows = rows[(offset[rows] @ self.along @ part[:, :-1].T + part[:, -1] <= 1e-6).all(axis=1)]
            inside[rows] = True
        return inside


def _points(wi: Direction, wo: Direction, isotropic: bool) -> np.ndarray:
    """Polar angles as radii about the normal, radians: (n, 3) for isotropic surfaces, else (n, 4)."""
    theta_i, theta_o = (np.arctan2(np.hypot(w.x, w.y), w.z) for w in (wi, wo))
    phi_i, phi_o = (np.arctan2(w.y, w.x) for w in (wi, wo))
    if isotropic:
        turn = np.where(theta_i > 1e-9, phi_o - phi_i, phi_o)
        return np.stack([theta_i, theta_o * np.cos(turn), theta_o * np.sin(turn)], axis=-1)
    return np.stack([r * g(p) for r, p in ((theta_i, phi_i), (theta_o, phi_o)) for g in (np.cos, np.sin)], axis=-1)
