"""Which nodes of a grid can go: each axis is thinned for as long as a scene's radiance stays within its tolerance.

Only the corners that a scene's directions need are gathered, out of the whole table, so that a trial costs a
millisecond and no copy. Interpolation is that of `gonio.data.interpolation.multilinear`.
"""

import dataclasses
import itertools
import math

import jax
import numpy as np

from gonio.data.interpolation.multilinear import interpolation_axis
from gonio.data.layouts import Layout
from gonio.data.scene import ScenePairs
from gonio.models.geometry.directions import Direction

FEWEST = 1
MOST_KNOWN = 256
LEAST_IMPORTANT = (0.5, 0.25, 0.1)  # shares of the nodes of an axis that one step tries to drop


@dataclasses.dataclass(frozen=True)
class Base:
    """A grid to thin: values (*shape, C), validity of the same shape, and what was done to get it."""

    layout: Layout
    f: np.ndarray
    valid: np.ndarray
    done: tuple[str, ...] = ()


class Thinning:
    """One base under one scene: errors of its subgrids.

    `guide`: the same on few pairs of directions, which says what node is missed least; without, this one does.
    """

    def __init__(self, base: Base, pairs: ScenePairs, truth: np.ndarray, guide: "Thinning | None" = None):
        self.guide = guide or self
        self.base, self.pairs, self.truth = base, pairs, truth
        self.names = tuple(base.layout.axes)
        self.at = coordinates(base.layout, pairs.wi, pairs.wo)
        self.known: dict[tuple, tuple] = {}
        self.asked: tuple = (None, None)  # what was last asked of `_missed`, and its answer
        self.whole = tuple(np.arange(a.size) for a in base.layout.axes.values())

    def error(self, kept: tuple[np.ndarray, ...]) -> float:
        """The scene's error of the table of these nodes, single precision."""
        brackets = [self._bracket(k, number) for k, number in enumerate(kept)]
        total = np.zeros((self.pairs.view.size, self.base.f.shape[-1]))
        weight = np.zeros_like(total)
        for corner in itertools.product((0, 1), repeat=len(brackets)):
            index = tuple(nodes[side] for (nodes, _), side in zip(brackets, corner, strict=True))
            w = math.prod((ws[side] for (_, ws), side in zip(brackets, corner, strict=True)), start=1.0)
            w = w[:, None] * self.base.valid[index]
            total += w * np.where(w > 0, self.base.f[index], 0.0).astype(np.float32)
            weight += w
        f = np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), 0.0)
        return self.pairs.error(f, self.truth)

    def _bracket(self, k: int, number: np.ndarray):
        # Trials change one axis at a time: the brackets of the others are those of the trial before.
        key = (k, number.tobytes())
        if key not in self.known:
            if len(self.known) > MOST_KNOWN:
                self.known.clear()
            name = self.names[k]
            axis = self.base.layout.axes[name][number]
            layout = self.base.layout.with_axes({**self.base.layout.axes, name: axis})
            self.known[key] = bracket(layout, name, self.at[k], number)
        return self.known[key]

    def thin(self, tolerance: float) -> tuple[np.ndarray, ...] | None:
        """The fewest nodes found that keep the error within the tolerance; None where all of them do not."""
        kept = self.whole
        if not self.error(kept) <= tolerance:
            return None
        exhausted: set[tuple] = set()
        while True:
            best, best_worth = None, 0.0
            for k in range(len(kept)):
                for share in LEAST_IMPORTANT:
                    trial = self._dropped(kept, k, share)
                    key = tuple(t.tobytes() for t in trial) if trial is not None else None
                    if key is None or key in exhausted:
                        continue
                    error = self.error(trial)
                    if not error <= tolerance:
                        exhausted.add(key)
                        continue
                    # What is saved, for what it uses up of what is left of the tolerance.
                    worth = math.log(kept[k].size / trial[k].size) / max(error / tolerance, 0.05)
                    if worth > best_worth:
                        best, best_worth = trial, worth
                    break
            if best is None:
                return self._last(kept, tolerance)
            kept = best

    def _dropped(self, kept, k: int, share: float):
        """The nodes less a share of those of axis k that are missed least, no two neighbours at once."""
        nodes = kept[k]
        number = max(1, int(nodes.size * share))
        if nodes.size - number < FEWEST:
            return None
        if share == LEAST_IMPORTANT[0]:
            half = nodes[::2] if nodes.size > 2 else nodes[: nodes.size - 1]
            return (*kept[:k], half, *kept[k + 1 :])
        missed = self._missed(kept, k)
        gone: set[int] = set()
        for j in np.argsort(missed, kind="stable"):
            if len(gone) == number:
                break
            if j - 1 not in gone and j + 1 not in gone:
                gone.add(int(j))
        left = np.array([n for j, n in enumerate(nodes) if j not in gone])
        return (*kept[:k], left, *kept[k + 1 :])

    def _missed(self, kept, k: int) -> np.ndarray:
        nodes = kept[k]
        if nodes.size == 1:
            return np.array([np.inf])
        key = (k, *(a.tobytes() for a in kept))
        if self.asked[0] != key:
            without = [self.guide.error((*kept[:k], np.delete(nodes, j), *kept[k + 1 :])) for j in range(nodes.size)]
            self.asked = (key, np.array(without))
        return self.asked[1]

    def _last(self, kept, tolerance: float):
        """One node at a time, from the axis with the fewest nodes, where one is the largest share.

        Which node is missed least is asked once an axis: it changes little, and each answer costs a trial a node.
        """
        missed = [self._missed(kept, k) for k in range(len(kept))]
        going = [k for k in range(len(kept)) if kept[k].size > FEWEST]
        while going:
            k = min(going, key=lambda k: kept[k].size)
            j = int(np.argmin(missed[k]))
            trial = (*kept[:k], np.delete(kept[k], j), *kept[k + 1 :])
            if self.error(trial) <= tolerance:
                kept, missed[k] = trial, np.delete(missed[k], j)
                going = [g for g in going if kept[g].size > FEWEST]
            else:
                going.remove(k)
        return kept


def coordinates(layout: Layout, wi: Direction, wo: Direction) -> list[np.ndarray]:
    """The coordinates of pairs of directions (N,) on the axes of a layout, radians."""
    pair = (Direction(*(np.asarray(c, float) for c in w)) for w in (wi, wo))
    angles = jax.vmap(layout.coordinates)(*pair)
    return [np.asarray(angles[name]) for name in layout.axes]


def bracket(layout: Layout, name: str, x: np.ndarray, number: np.ndarray):
    """((lower, upper) numbers of nodes in the base, their weights) of the coordinates x on one axis of a thinned grid.

    `number` (n,): which node of the base each of the axis' nodes is.
    """
    axis = interpolation_axis(layout, name)
    nodes = np.asarray(axis.nodes)
    if nodes.size == 1:
        zero = np.full(x.size, number[0])
        return (zero, zero), (np.ones(x.size), np.zeros(x.size))
    if axis.fold:
        x = np.minimum(x, 2 * np.pi - x)
    if axis.warp:
        x = np.sqrt(np.maximum(x, 0.0))
    if axis.period is not None:
        x = nodes[0] + np.mod(x - nodes[0], axis.period)
    low = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 1)
    high = (low + 1) % nodes.size if axis.period is not None else np.minimum(low + 1, nodes.size - 1)
    start, stop = nodes[low], nodes[high]
    if axis.period is not None:
        stop = np.where(high == 0, nodes[0] + axis.period, stop)
    width = stop - start
    w = np.clip((x - start) / np.where(width > 0, width, 1.0), 0.0, 1.0)
    return (number[low], number[high]), (1.0 - w, w)
