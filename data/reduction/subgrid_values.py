"""Interpolated values of the subgrids of one grid at fixed directions: what many trials of a search ask for.

Only the corners about the directions are gathered. From one subgrid to the next few directions have others: the values
of the rest are kept. Interpolation is that of `gonio.data.interpolation.multilinear`, in the same order, to the bit.
"""

import functools
import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gonio.data.interpolation.grid_coordinates import LightForAll, grid_coordinates, layout_coordinates, light_for_all
from gonio.data.interpolation.multilinear import axis_nodes
from gonio.data.layouts import Layout
from gonio.data.layouts.angle_layouts import IsotropicGrid
from gonio.data.reduction.stored_cells import Nodes, StoredCells, ValidCells
from gonio.models.geometry.directions import Direction

MAX_BRACKETS = 256
FEW = 0.5
"""Share of the directions up to which only those that have other corners are computed anew."""


class Bracket(NamedTuple):
    """Of each direction the (lower, upper) numbers of nodes on an axis of the whole grid, (2, n), and their weights."""

    nodes: np.ndarray
    weights: np.ndarray

    def differs(self, other: "Bracket") -> np.ndarray:
        """The directions, (n,), of which the nodes or weights are others."""
        return (self.nodes != other.nodes).any(0) | (self.weights != other.weights).any(0)


class SubgridValues:
    """Values at some directions of the tables of some nodes of each axis of a grid.

    Args:
        layout: of the whole grid.
        f: values (*shape, C).
        valid: whether they count, of the same shape.
        wi: directions of the light, (n,).
        wo: directions of the detector.
    """

    def __init__(
        self,
        layout: Layout,
        f: np.ndarray | StoredCells,
        valid: np.ndarray | ValidCells,
        wi: Direction,
        wo: Direction,
    ) -> None:
        self.layout, self.channels = layout, f.shape[-1]
        self._cells: Callable[[Nodes], tuple[np.ndarray, np.ndarray]] = lambda index: (valid[index], f[index])
        if isinstance(f, np.ndarray) and isinstance(valid, np.ndarray):
            one_for_all = valid.strides[-1] == 0  # broadcast over the channels
            rows = [a.reshape(layout.size, -1) for a in (valid[..., :1] if one_for_all else valid, f)]
            self._cells = lambda index: _rows(rows, np.ravel_multi_index(index, layout.shape))
        wi, wo = (Direction(*(np.asarray(c, float) for c in w)) for w in (wi, wo))
        self.coordinates, self.covered = layout_coordinates(layout, wi, wo)
        self._directions = wi, wo
        self._brackets: dict[tuple[str, bytes, float | None], Bracket] = {}
        self._before: tuple[list[Bracket], np.ndarray] | None = None

    def of(self, kept: Nodes) -> np.ndarray:
        """f (n, C) of the table of these nodes, single precision; 0 where no cell has a value."""
        named = dict(zip(self.layout.axes, kept, strict=True))
        light = None
        if "phi_i" in named and named["phi_i"].size == 1:
            light = light_for_all(self.layout.part(**named))
        brackets = [self._bracket(name, nodes, light if name == "phi_o" else None) for name, nodes in named.items()]
        if self._before is None:
            values = self._interpolated(brackets)
        else:
            others = [new.differs(old) for new, old in zip(brackets, self._before[0], strict=True) if new is not old]
            rows = np.flatnonzero(np.any(others, axis=0)) if others else np.zeros(0, int)
            if rows.size > FEW * self.covered.size:
                values = self._interpolated(brackets)
            else:
                values = self._before[1].copy()
                values[rows] = self._interpolated([Bracket(b.nodes[:, rows], b.weights[:, rows]) for b in brackets])
        self._before = brackets, values
        return values

    def _interpolated(self, brackets: list[Bracket]) -> np.ndarray:
        total = np.zeros((brackets[0].nodes.shape[1], self.channels))
        weight = np.zeros_like(total)
        for corner in itertools.product((0, 1), repeat=len(brackets)):
            index = tuple(b.nodes[side] for b, side in zip(brackets, corner, strict=True))
            share = functools.reduce(np.multiply, (b.weights[side] for b, side in zip(brackets, corner, strict=True)))
            valid, f = self._cells(index)
            w = share[:, None] * valid
            total += w * np.where(w > 0, f, 0.0).astype(np.float32)
            weight += w
        return np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), 0.0)

    @functools.cached_property
    def _from_light(self) -> np.ndarray:
        """Azimuths from the light, (n,)."""
        return grid_coordinates(IsotropicGrid, *self._directions)[0]["delta_phi"]

    def _bracket(self, name: str, nodes: np.ndarray, light: LightForAll | None) -> Bracket:
        # Trials change one axis at a time: the brackets of the others are those of the trial before.
        key = (name, nodes.tobytes(), None if light is None else light.azimuth)
        if key not in self._brackets:
            if len(self._brackets) > MAX_BRACKETS:
                self._brackets.clear()
            layout, x = self.layout.part(**{name: nodes}), self.coordinates[name] if light is None else self._from_light
            if light is not None:
                order, name = np.argsort(light.delta_phi), "delta_phi"
                nodes, azimuths = nodes[order], light.delta_phi[order]
                layout = IsotropicGrid({k: layout.axes[k] for k in ("theta_i", "theta_o")} | {name: azimuths})
            (low, high), weights = axis_nodes(layout, name).bracket(np.asarray(x))
            self._brackets[key] = Bracket(np.stack([nodes[low], nodes[high]]), np.stack(weights))
        return self._brackets[key]


def _rows(arrays: list[np.ndarray], numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return arrays[0][numbers], arrays[1][numbers]
