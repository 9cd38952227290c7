"""A table as a material: multilinear interpolation in the layout's own coordinates.

Cells without a value take no part: the weights of the others are scaled up, and f is 0 where none is left.
Beyond its outermost nodes an axis is held constant; azimuths are periodic. Scattered samples: see
`gonio.data.interpolation.scattered`.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from gonio.data.flags import Flag
from gonio.data.interpolation.grid_coordinates import grid_coordinates, light_for_all
from gonio.data.interpolation.mirror_signs import on_one_side, with_signs
from gonio.data.interpolation.two_sided import TwoSided
from gonio.data.layouts.angle_layouts import isotropic as isotropic_grid
from gonio.data.layouts.base import Layout
from gonio.data.polarisation import are_their_own_exchange
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.horizon import HORIZON
from gonio.models.geometry.sides import FRONT


class AxisNodes(NamedTuple):
    """Increasing nodes of one coordinate, and how a value finds its cell; no PyTree, and made in no time."""

    nodes: Any
    period: float | None
    step: float | None
    warp: bool
    fold: bool

    def bracket(self, x: Any, xp: ModuleType = np) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """As `InterpolationAxis.bracket` says."""
        nodes, n = xp.asarray(self.nodes), self.nodes.shape[0]
        if self.fold:
            x = xp.minimum(x, 2 * xp.pi - x)
        if self.warp:
            x = xp.sqrt(xp.maximum(x, 0.0))
        if n == 1:
            zero = xp.zeros(xp.shape(x), xp.int32)
            return (zero, zero), (xp.ones_like(x), xp.zeros_like(x))
        first = nodes[0]
        if self.period is not None:
            x = first + xp.mod(x - first, self.period)
        if self.step is not None:
            low = xp.clip(xp.floor((x - first) / self.step), 0, n - 1).astype(xp.int32)
        else:
            low = xp.clip(xp.searchsorted(nodes, x, side="right") - 1, 0, n - 1).astype(xp.int32)
        high = (low + 1) % n if self.period is not None else xp.minimum(low + 1, n - 1)
        start, stop = nodes[low], nodes[high]
        if self.period is not None:
            stop = xp.where(high == 0, first + self.period, stop)
        width = stop - start
        w = xp.clip((x - start) / xp.where(width > 0, width, 1.0), 0.0, 1.0)
        return (low, high), (1.0 - w, w)


class InterpolationAxis(eqx.Module):
    """`AxisNodes` of JAX."""

    nodes: Float[Array, " n"]
    period: float | None = eqx.field(static=True)
    step: float | None = eqx.field(static=True)
    warp: bool = eqx.field(static=True)
    fold: bool = eqx.field(static=True)

    def bracket(self, x: Any, xp: ModuleType = jnp) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """((lower, upper) node numbers, their weights) of values of the coordinate, radians; `xp`: JAX or NumPy."""
        return AxisNodes(self.nodes, self.period, self.step, self.warp, self.fold).bracket(x, xp)


AT_NODE = 1e-9
"""Weight of a node below which directions lie at the others, but for rounding."""
_Corner = tuple[tuple[np.ndarray, ...], np.ndarray]
"""The numbers of a node on each axis, (n,) each, and its weight, (n,)."""


class Tabulated(AbstractBRDF):
    """The multilinear interpolant of a gridded table. Out of the plane of an in-plane table f is NaN: nobody looked."""

    values: Float[Array, "*cells channel"]
    valid: Bool[Array, "*cells one_or_channel"]
    axes: tuple[InterpolationAxis, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    kind: type[Layout] = eqx.field(static=True)
    same_all_round: bool = eqx.field(static=True)

    @property
    def isotropic(self) -> bool:
        return self.same_all_round

    def formula(self, wi: Direction, wo: Direction) -> Float[Array, " channel"]:
        coordinates = self.kind.coordinates(wi, wo)
        brackets = [axis.bracket(coordinates[name]) for axis, name in zip(self.axes, self.names, strict=True)]
        # One gather of all corners: a gather for each of them takes seconds to compile.
        nodes = jnp.meshgrid(*(jnp.stack(n) for n, _ in brackets), indexing="ij")
        corners = jnp.meshgrid(*(jnp.stack(w) for _, w in brackets), indexing="ij")
        weight = jnp.where(self.valid[tuple(nodes)], math.prod(corners[1:], start=corners[0])[..., None], 0.0)
        every = tuple(range(len(brackets)))
        total, weight = jnp.sum(weight * self.values[tuple(nodes)], every), jnp.sum(weight, every)
        known = weight > 0
        value = jnp.where(known, total / jnp.where(known, weight, 1.0), 0.0)
        covered = self.kind.covers(wi, wo)
        if covered is not True:
            value = jnp.where(covered, value, jnp.nan)
        return value

    def array_values(self, wi: Direction, wo: Direction) -> np.ndarray | None:
        if any(isinstance(v, Tracer) for v in jax.tree.leaves(self)):
            return None
        values, valid = np.asarray(self.values), np.asarray(self.valid)
        total, weight = (np.zeros((wi.z.size, a.shape[-1]), values.dtype) for a in (values, valid))
        shown, covered, corners = self._corners(wi, wo)
        for index, share in corners:
            share = np.where(valid[index], share[:, None], 0.0)
            total[shown] += share * values[index]
            weight[shown] += share
        f = np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), 0.0).astype(values.dtype)
        f[shown[~covered]] = np.nan
        return f

    def ends(self, wi: Direction, wo: Direction) -> tuple[np.ndarray, np.ndarray]:
        """The least and the greatest, (n, C) each, of the readings around directions (n,); NaN where one is missing.

        No monotone function between the nodes leaves them.
        """
        values, valid = np.asarray(self.values), np.asarray(self.valid)
        least, most = (np.full((wi.z.size, values.shape[-1]), v) for v in (np.inf, -np.inf))
        shown, _, corners = self._corners(wi, wo)
        for index, share in corners:
            counts = (share > AT_NODE)[:, None]
            f = np.where(valid[index], values[index], np.nan)
            least[shown] = np.where(counts, np.minimum(least[shown], f), least[shown])
            most[shown] = np.where(counts, np.maximum(most[shown], f), most[shown])
        none = ~np.isfinite(least)
        return np.where(none, np.nan, least), np.where(none, np.nan, most)

    def _corners(self, wi: Direction, wo: Direction) -> tuple[np.ndarray, np.ndarray, Iterator[_Corner]]:
        """Which directions are above the horizon, which of these the layout can hold, and the nodes around them."""
        shown = np.flatnonzero(np.minimum(wi.z, wo.z) > HORIZON)
        wi, wo = (Direction(*(c[shown] for c in w)) for w in (wi, wo))
        coordinates, covered = grid_coordinates(self.kind, wi, wo)
        brackets = [axis.bracket(coordinates[name], np) for axis, name in zip(self.axes, self.names, strict=True)]

        def corner(sides: tuple[int, ...]) -> _Corner:
            index = tuple(nodes[side] for (nodes, _), side in zip(brackets, sides, strict=True))
            weights = (of[side] for (_, of), side in zip(brackets, sides, strict=True))
            return index, np.asarray(math.prod(weights, start=1.0))

        return shown, covered, map(corner, itertools.product((0, 1), repeat=len(brackets)))


def as_material(table: Table) -> AbstractBRDF:
    """The BRDF that a table stands for: its format's own interpolant where it has one, else `Tabulated`.

    Of a table of both sides of a sample each part is interpolated by itself, see `Table.parts`. Raises GonioError where
    the table holds no valid reading, or too many scattered ones.
    """
    if table.interpolant is not None:
        return table.interpolant()
    if not table.valid_cells().size:
        raise GonioError(f"table {table.name or 'without a name'} holds no valid reading; nothing can be interpolated")
    if table.sides == FRONT:
        return _interpolant(table, True)
    parts = [(sides, part) for sides, part in table.parts().items() if part.valid_cells().size]
    front, behind = table.media
    brdfs = tuple(_interpolant(part, a == b) for (a, b), part in parts)
    return TwoSided(brdfs, tuple(sides for sides, _ in parts), jnp.asarray(behind / front, jnp.result_type(float)))


def _interpolant(table: Table, reciprocal: bool) -> AbstractBRDF:
    """The interpolant of one part of a table; `reciprocal`: whether scattered samples stand for swapped directions."""
    if not are_their_own_exchange(table.channels.names) and takes_mirror_images(table.layout):
        return with_signs(_of_part(on_one_side(table), reciprocal), table)
    return _of_part(table, reciprocal)


def takes_mirror_images(layout: Layout) -> bool:
    """Whether readings on one side of the plane of incidence stand for the other side too."""
    if layout.gridded:
        return bool(layout.mirrored_axes)
    from gonio.data.interpolation.inverse_distance import one_azimuth

    return one_azimuth(layout.directions(0, layout.size)[0])


def _of_part(table: Table, reciprocal: bool) -> AbstractBRDF:
    if not table.layout.gridded:
        from gonio.data.interpolation.scattered import scattered_material

        return scattered_material(table, reciprocal)
    table = with_light_at_x(table)
    valid = np.asarray(table.flag[...]) == Flag.VALID
    values = np.where(valid, np.asarray(table.f[...]), 0.0)
    if (valid == valid[..., :1]).all():
        valid = valid[..., :1]
    dtype = jnp.result_type(float)
    layout = table.layout
    axes = tuple(interpolation_axis(layout, name) for name in layout.axes)
    kind, isotropic = type(layout), not layout.has_azimuth_of_light
    return Tabulated(jnp.asarray(values, dtype), jnp.asarray(valid), axes, tuple(layout.axes), kind, isotropic)


def with_light_at_x(table: Table) -> Table:
    """The same readings by the azimuth from the light, where a grid has them for light of one azimuth alone.

    That azimuth stands for all: the surface is taken as isotropic.
    """
    layout = table.layout
    if (light := light_for_all(layout)) is None:
        return table
    delta = light.delta_phi
    order = np.argsort(delta)
    turned = isotropic_grid(layout.axes["theta_i"], layout.axes["theta_o"], delta[order])
    f, flag, u_f = (
        None if a is None else np.asarray(a[...])[:, 0][:, :, order] for a in (table.f, table.flag, table.u_f)
    )
    return dataclasses.replace(table, layout=turned, f=f, flag=flag, u_f=u_f)


def axis_nodes(layout: Layout, name: str) -> AxisNodes:
    """The nodes of one axis of a gridded layout, in the coordinate in which they are interpolated."""
    nodes = layout.axes[name]
    quadratic = {kind.name for kind in layout.axis_kinds if kind.quadratic}
    warp = name in quadratic and _uniform(np.sqrt(nodes)) and not _uniform(nodes)
    if warp:
        nodes = np.sqrt(nodes)
    step = float(nodes[1] - nodes[0]) if _uniform(nodes) else None
    return AxisNodes(nodes, layout.periods[name], step, warp, name in layout.mirrored_axes)


def interpolation_axis(layout: Layout, name: str) -> InterpolationAxis:
    """`axis_nodes` as JAX takes them."""
    axis = axis_nodes(layout, name)
    return InterpolationAxis(jnp.asarray(axis.nodes, jnp.result_type(float)), *axis[1:])


def _uniform(nodes: np.ndarray) -> bool:
    # Far inside the rounding of a cell's number: a node that floor() puts into the cell below has weight 1 there.
    steps = np.diff(nodes)
    return nodes.size > 1 and bool((np.abs(steps - steps[0]) <= 1e-9 * np.abs(steps[0])).all())


def interpolation(table: Table) -> str:
    """One sentence on how `as_material` interpolates this table: for reports and provenance."""
    if table.interpolant is not None:
        return "by the format's own rule"
    if not table.layout.gridded:
        from gonio.data.interpolation.scattered import description

        parts = table.parts().items()
        texts = [description(part, reciprocal=a == b) for (a, b), part in parts if part.valid_cells().size]
        return "; ".join(dict.fromkeys(texts))
    axes = {name: interpolation_axis(table.layout, name) for name in table.layout.axes}
    names = [f"sqrt({name})" if axis.warp else name for name, axis in axes.items()]
    text = f"multilinear in {', '.join(names)}; constant beyond the outermost nodes"
    if table.sides != FRONT:
        text += ", of each side of the sample by itself"
    for name in table.layout.mirrored_axes:
        text += f"; {name} stops at pi, so the other half is taken as its mirror image"
    return text


def coarsened(table: Table) -> Table:
    """The table of every second node of each axis that has more than two (of every second scattered sample),
    or the same cells read by a format's own interpolant of half the nodes.

    What differs between this table's interpolant and the whole one's bounds the whole one's error:
    interpolation of a smooth function is of second order, so a grid of half the nodes errs by four times as
    much.
    """
    if table.interpolant is not None:
        return dataclasses.replace(table, interpolant=partial(table.interpolant, coarse=True))
    layout = table.layout
    step = {name: slice(None, None, 2 if axis.size > 2 else 1) for name, axis in layout.axes.items()}
    cells = tuple(step.values())[: len(layout.shape)]
    f, flag, u_f = (None if a is None else np.asarray(a[...])[cells] for a in (table.f, table.flag, table.u_f))
    coarser = layout.part(**step)
    return dataclasses.replace(table, layout=coarser, interpolant=None, f=f, flag=flag, u_f=u_f)
