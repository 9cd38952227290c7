"""Removal of nodes from a grid, axis by axis, as long as a scene's radiance stays within its tolerance.

Only the corners that a scene's directions need are gathered, out of the whole grid, so that a trial costs less than a
millisecond and no copy (`gonio.data.reduction.subgrid_values`).
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from gonio.data.layouts import Layout
from gonio.data.reduction.stored_cells import Nodes, StoredCells, ValidCells
from gonio.data.reduction.subgrid_values import SubgridValues
from gonio.data.scene import ScenePairs

SHARES = (0.5, 0.25, 0.1)  # of the nodes of an axis that one step tries to remove


@dataclasses.dataclass(frozen=True)
class StartGrid:
    """A grid to thin: values (*shape, C), validity of the same shape, the simplifications that led to it, in words."""

    layout: Layout
    f: np.ndarray | StoredCells
    valid: np.ndarray | ValidCells
    simplified_by: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    """What else the whole table has, in words."""

    @property
    def nodes(self) -> Nodes:
        """All nodes of each axis."""
        return tuple(np.arange(n) for n in self.layout.shape)

    @property
    def size(self) -> int:
        """Number of its values."""
        return math.prod(self.f.shape)

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """f, and whether it is valid, of a grid that is in memory."""
        assert isinstance(self.f, np.ndarray) and isinstance(self.valid, np.ndarray)
        return self.f, self.valid

    def grey(self) -> "StartGrid":
        """The mean over the channels, valid where all of them are."""
        f, valid = self.arrays
        mean = np.mean(np.where(valid, f, 0.0), axis=-1, keepdims=True)
        words = f"colour: one channel in place of {f.shape[-1]}"
        return dataclasses.replace(self, f=mean, valid=valid.all(-1, keepdims=True), left_out=(words,))

    def part(self, nodes: Nodes) -> "StartGrid":
        """The grid of these nodes of each axis."""
        axes, index = self.layout.axes.items(), np.ix_(*nodes)
        ranges = [(name, axis.size, np.degrees(axis[k])) for (name, axis), k in zip(axes, nodes, strict=True)]
        words = [f"{name}: {kept.size} of {count} nodes, {kept[0]:.4g}° to {kept[-1]:.4g}°"
                 for name, count, kept in ranges if kept.size < count]  # fmt: skip
        layout = self.layout.part(**dict(zip(self.layout.axes, nodes, strict=True)))
        left_out = (*self.left_out, *words)
        return dataclasses.replace(self, layout=layout, f=self.f[index], valid=self.valid[index], left_out=left_out)


class SceneValues(NamedTuple):
    """Pairs of directions of a scene, and the whole table's f (N, C) there."""

    pairs: ScenePairs
    f: np.ndarray


def interpolated(grid: StartGrid, pairs: ScenePairs) -> np.ndarray:
    """f (N, C) of the interpolant of a grid at a scene's pairs; NaN where its layout has no such directions."""
    thinning = Thinning(grid, SceneValues(pairs, np.zeros((pairs.view.size, grid.f.shape[-1]))))
    return np.where(thinning.covered[:, None], thinning.values(grid.nodes), np.nan)


class Thinning:
    """Errors of the subgrids of one grid under one scene.

    Args:
        grid: what is thinned.
        scene: what the errors are taken of.
        guide: the same on few pairs, which ranks the nodes by their importance; without, `scene` does.
    """

    def __init__(self, grid: StartGrid, scene: SceneValues, guide: SceneValues | None = None) -> None:
        self.grid, (self.pairs, self.truth) = grid, scene
        self.guide = self if guide is None else Thinning(grid, guide)
        self._subgrids = SubgridValues(grid.layout, grid.f, grid.valid, self.pairs.wi, self.pairs.wo)
        self._ranking: tuple[tuple[bytes, ...], np.ndarray] = ((), np.empty(0))

    @property
    def coordinates(self) -> dict[str, np.ndarray]:
        """The angles of the scene's pairs, (N,), on each axis, radians."""
        return self._subgrids.coordinates

    @property
    def covered(self) -> np.ndarray:
        """Which of the scene's pairs, (N,), the layout has."""
        return self._subgrids.covered

    def error(self, kept: Nodes) -> float:
        """The scene's error of the table of these nodes, single precision."""
        return self.pairs.error(self.values(kept), self.truth)

    def values(self, kept: Nodes) -> np.ndarray:
        """f (N, C) of the table of these nodes, single precision, at the scene's pairs; 0 where no cell has a value."""
        return self._subgrids.of(kept)

    def thin(self, tolerance: float) -> Nodes | None:
        """The fewest nodes found by greedy removal within the tolerance; None where all of them are not within it."""
        kept = self.grid.nodes
        if not self.error(kept) <= tolerance:
            return None
        refused: set[tuple[bytes, ...]] = set()
        while True:
            best, highest = None, 0.0
            for k in range(len(kept)):
                for share in SHARES:
                    trial = self._without_share(kept, k, share)
                    if trial is None or (key := _key(trial)) in refused:
                        continue
                    error = self.error(trial)
                    if not error <= tolerance:
                        refused.add(key)
                        continue
                    # What is saved, for what it uses up of what is left of the tolerance.
                    merit = math.log(kept[k].size / trial[k].size) / max(error / tolerance, 0.05)
                    if merit > highest:
                        best, highest = trial, merit
                    break
            if best is None:
                return self._one_by_one(kept, tolerance)
            kept = best

    def _without_share(self, kept: Nodes, k: int, share: float) -> Nodes | None:
        """The nodes without the least important share of axis k, no two neighbours at once; None for one node."""
        nodes = kept[k]
        number = max(1, int(nodes.size * share))
        if nodes.size == 1:
            return None
        if share == SHARES[0]:
            return _replaced(kept, k, nodes[::2] if nodes.size > 2 else nodes[:1])
        removed: set[int] = set()
        for j in np.argsort(self._errors_without(kept, k), kind="stable").tolist():
            if len(removed) < number and j - 1 not in removed and j + 1 not in removed:
                removed.add(j)
        return _replaced(kept, k, np.delete(nodes, sorted(removed)))

    def _errors_without(self, kept: Nodes, k: int) -> np.ndarray:
        """The guide's error without each node of axis k."""
        nodes = kept[k]
        if nodes.size == 1:
            return np.array([np.inf])
        key = (bytes([k]), *_key(kept))
        if self._ranking[0] != key:
            errors = [self.guide.error(_replaced(kept, k, np.delete(nodes, j))) for j in range(nodes.size)]
            self._ranking = (key, np.array(errors))
        return self._ranking[1]

    def _one_by_one(self, kept: Nodes, tolerance: float) -> Nodes:
        """One node at a time, from the axis with the fewest nodes, where one is the largest share.

        Nodes are ranked once an axis: the ranking changes little, and each costs a trial a node.
        """
        errors = [self._errors_without(kept, k) for k in range(len(kept))]
        open_axes = [k for k in range(len(kept)) if kept[k].size > 1]
        while open_axes:
            k = min(open_axes, key=lambda k: kept[k].size)
            j = int(np.argmin(errors[k]))
            trial = _replaced(kept, k, np.delete(kept[k], j))
            if self.error(trial) <= tolerance:
                kept, errors[k] = trial, np.delete(errors[k], j)
                open_axes = [a for a in open_axes if kept[a].size > 1]
            else:
                open_axes.remove(k)
        return kept


def _replaced(kept: Nodes, k: int, nodes: np.ndarray) -> Nodes:
    return (*kept[:k], nodes, *kept[k + 1 :])


def _key(kept: Nodes) -> tuple[bytes, ...]:
    return tuple(nodes.tobytes() for nodes in kept)
