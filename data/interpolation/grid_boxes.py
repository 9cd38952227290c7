"""Pairs of directions by the boxes of a grid that they lie in: many pairs of few boxes share the work at corners."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gonio.data.interpolation.multilinear import InterpolationAxis, interpolation_axis
from gonio.data.layouts.base import Layout


def interpolation_axes(layout: Layout) -> tuple[InterpolationAxis, ...]:
    """Those of all axes of a gridded layout, in its order."""
    return tuple(interpolation_axis(layout, name) for name in layout.axes)


class GridBoxes(NamedTuple):
    """n pairs of directions in B boxes of a grid, those of one box side by side.

    Attributes:
        order: numbers (n,) of the pairs, box by box.
        starts: where the pairs of each box begin in that order, and the end of all (B + 1,).
        cells: numbers (corners, B) of the cells at the corners of each box.
        weight: of the corners of each pair (corners, n), by multilinear interpolation, in that order.
        sides: of each axis, the numbers of the nodes below and above each pair, and their weights, in that order.
    """

    order: np.ndarray
    starts: np.ndarray
    cells: np.ndarray
    weight: np.ndarray
    sides: tuple[tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], ...]

    @classmethod
    def of(cls, layout: Layout, axes: Sequence[InterpolationAxis], x: Mapping[str, np.ndarray]) -> "GridBoxes":
        """Those of coordinates (n,) by axis; `axes` are those of the layout."""
        brackets = [axis.bracket(x[name], np) for name, axis in zip(layout.axes, axes, strict=True)]
        box = np.ravel_multi_index([np.asarray(nodes[0], int) for nodes, _ in brackets], layout.shape)
        which, rank = _distinct(box, layout.size)
        order = np.argsort(rank.astype(np.uint16) if which.size < 1 << 16 else rank, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(rank, minlength=which.size))])
        sides = tuple(
            ((low[order], high[order]), (below[order], above[order])) for (low, high), (below, above) in brackets
        )
        corners = list(np.ndindex(*[2] * len(sides)))
        first = starts[:-1]
        cells = [
            np.ravel_multi_index([nodes[s][first] for (nodes, _), s in zip(sides, corner, strict=True)], layout.shape)
            for corner in corners
        ]
        weight = np.ones((1, box.size))
        for _, shares in sides:
            weight = (weight[:, None] * np.stack(shares)).reshape(-1, box.size)
        return cls(order, starts, np.stack(cells), weight, sides)

    def of_valid(self, valid: np.ndarray) -> "GridBoxes":
        """The same where only cells that are valid (cells,) have weight, and those of a pair still add up to 1."""
        there = valid[self.cells]
        if there.all():
            return self
        weight = self.weight * np.repeat(there, np.diff(self.starts), axis=1)
        return self._replace(weight=weight / np.maximum(weight.sum(axis=0), 1e-300))

    def summed(self, values: np.ndarray) -> np.ndarray:
        """Σ over the pairs of each box of weight times values (n, m) in its order: (corners, B, m)."""
        sums = np.empty((*self.cells.shape, values.shape[1]))
        for b, these in enumerate(self._slices()):
            np.matmul(self.weight[:, these], values[these], out=sums[:, b])
        return sums

    def interpolated(self, values: np.ndarray) -> np.ndarray:
        """Values (corners, B, m) at the corners of the boxes, interpolated at each pair in its order: (n, m)."""
        made = np.empty((self.order.size, values.shape[2]))
        for b, these in enumerate(self._slices()):
            np.matmul(self.weight[:, these].T, values[:, b], out=made[these])
        return made

    def pieces(self, most: int) -> "Iterator[tuple[slice, slice, GridBoxes]]":
        """Boxes side by side that hold no more pairs than `most`, or one box: their slice, and that of the pairs."""
        first = 0
        while first < len(self.starts) - 1:
            last = max(first + 1, int(np.searchsorted(self.starts, self.starts[first] + most, "right")) - 1)
            boxes, these = slice(first, last), slice(int(self.starts[first]), int(self.starts[last]))
            sides = tuple(((a[these], b[these]), (c[these], d[these])) for (a, b), (c, d) in self.sides)
            starts = self.starts[first : last + 1] - self.starts[first]
            yield boxes, these, GridBoxes(self.order[these], starts, self.cells[:, boxes], self.weight[:, these], sides)
            first = last

    def _slices(self) -> list[slice]:
        return [slice(a, b) for a, b in zip(self.starts[:-1].tolist(), self.starts[1:].tolist(), strict=True)]


def _distinct(numbers: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """The distinct ones of numbers below `most`, rising, and which of them each is."""
    if most > 4 * numbers.size + 1024:
        return np.unique(numbers, return_inverse=True)
    present = np.zeros(most, bool)
    present[numbers] = True
    return np.flatnonzero(present), (np.cumsum(present) - 1)[numbers]
