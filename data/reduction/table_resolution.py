"""How well a table resolves a scene: the error of its own radiance, below which no table reduced from it can promise.

Where the provenance names the material the error is measured against that. Else it is estimated from the nodes: what
leaving out every second node changes, and every second of those that are left, is continued to the table's own step.
"""

import dataclasses
import itertools
import math
from typing import NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.interpolation.coverage import covered
from gonio.data.interpolation.multilinear import as_material, coarsened, interpolation_axis
from gonio.data.layouts.base import Layout
from gonio.data.reduction.stored_cells import ValidCells, coarse_table, is_stored
from gonio.data.reduction.thin_grid import SceneValues, StartGrid, Thinning
from gonio.data.scene import ScenePairs
from gonio.data.table import FOLDED, Table
from gonio.models.display import percent
from gonio.models.errors import GonioError
from gonio.models.evaluation import channel_count, evaluate_in_blocks
from gonio.models.expression.builder import build
from gonio.models.folded import seen_from
from gonio.models.geometry.sides import FRONT

RESOLVED = 0.3
"""Of the radiance: where leaving out every second node changes more, the nodes do not resolve what the scene sees."""
LEAST, MOST = 2 / 3, 1.5
"""Error of a grid over the change by leaving out half of its nodes: twice that of a rule of second order; and at worst,
where a lobe is narrower than the step and its part of the radiance is all in doubt."""
BEYOND = 2.0
"""Error beyond the outermost nodes over what f changes by as far within them: f grows towards grazing."""
UNEVEN = 1.5
"""Ratio of the widest step of an axis to its narrowest from which leaving out nodes does not double every step."""
ISOLATED = 2.0
"""Ratio of a step to those beside it from which on it is a hole."""
UNREAD = 0.01
"""Share of the light that may come from, or go to, directions about which nothing was read."""
NOISE_READINGS = 1 << 20
"""Of a table larger than memory, from which the noise is taken."""
DRAWS = 8
"""Of the noise: the largest of their errors counts."""
MARGIN, PARTS, SAMPLING = 3.0, 16, 0.1
"""Standard errors, by the scatter of so many parts of a scene, that the square of a measured error is raised by, and at
least so much of it."""


class Resolution(NamedTuple):
    """The rms error of a table's radiance over its rms, as a bound; infinite where the table does not resolve it."""

    error: float
    reason: str


def known_truth(table: Table, pairs: ScenePairs) -> np.ndarray | None:
    """f (N, C) of the material that the provenance of a simulated table names; None where it names none that fits.

    Of readings that were mirrored into the front it is that of the material as these see it.
    """
    material = table.provenance.get("material")
    expression = material.get("spelling") if isinstance(material, dict) else None
    if not isinstance(expression, str):
        return None
    try:
        brdf = build(expression)
    except GonioError:
        return None
    sides = table.provenance.get(FOLDED, [[1, 1]])
    count = len(table.channels) // len(sides)
    if channel_count(brdf) not in (None, count):
        return None
    each = (evaluate_in_blocks(seen_from(brdf, *pair), pairs.wi, pairs.wo) for pair in sides)
    return np.concatenate([np.broadcast_to(f, (pairs.view.size, count)) for f in each], axis=1)


def measured_error(pairs: ScenePairs, f: np.ndarray, truth: np.ndarray) -> float:
    """The relative rms error of f, (N, C), in a scene, raised by what the choice of the pairs may hide."""
    squared = np.sum(pairs.share[:, None] * pairs.radiances(f - truth) ** 2, axis=1)
    parts = PARTS * np.bincount(np.arange(squared.size) % PARTS, squared, PARTS)
    spread = np.std(parts, ddof=1) / math.sqrt(PARTS) / max(float(squared.sum()), 1e-300)
    return pairs.error(f, truth) * math.sqrt(1.0 + max(MARGIN * spread, SAMPLING))


def resolution(table: Table, scene: SceneValues) -> Resolution:
    """How well a table resolves a scene, by its readings alone: the bound is relative to the surface's radiance.

    Args:
        table: of the whole hemisphere.
        scene: pairs of directions of a scene, and the values there of the table's interpolant.
    """
    error, reason = bound_of_sides(table, scene, scene.pairs.rms(scene.f))
    return Resolution(of_surface(error), reason)


def of_surface(error: float) -> float:
    """A bound relative to the radiance of the surface, from one relative to a radiance that is off it by so much."""
    return error / (1 - error) if error < 1 else math.inf


def bound_of_sides(table: Table, scene: SceneValues, rms: float) -> Resolution:
    """`interpolation_bound` of a scene with lights or views behind the sample: the sum of those of each two sides."""
    if table.sides == FRONT:
        return interpolation_bound(table, scene, rms)
    parts, bounds = table.parts(), []
    for sides, (here, pairs) in scene.pairs.by_side().items():
        bounds.append(interpolation_bound(parts[sides], SceneValues(pairs, scene.f[here]), rms))
    return Resolution(sum(b.error for b in bounds), max(bounds, key=lambda b: b.error).reason)


def interpolation_bound(table: Table, scene: SceneValues, rms: float) -> Resolution:
    """What interpolating a table may err by in a scene, over a radiance `rms`; see `resolution`."""
    pairs = scene.pairs
    light = pairs.share[pairs.view] * pairs.amount
    unread = float(np.sum(light[~covered(table, pairs.wi, pairs.wo, beyond=1.0)]) / np.sum(light))
    if unread > UNREAD:
        return Resolution(math.inf, f"{percent(unread)} of the light is at directions about which nothing was read")
    if table.interpolant is None and table.layout.gridded:
        return _of_grid(table, scene, rms)
    if table.interpolant is None:
        return Resolution(math.inf, "readings without a grid do not tell what lies between them")
    coarse = evaluate_in_blocks(as_material(coarsened(table)), pairs.wi, pairs.wo)
    return _judged(pairs.rms(coarse - scene.f) / rms, MOST, 0.0, 0.0)


def _judged(change: float, factor: float, beyond: float, noise: float) -> Resolution:
    """The bound from the relative change by leaving out half of the nodes."""
    error = math.hypot(factor * change + BEYOND * beyond, noise)
    words = f"leaving out every second node changes the radiance by {percent(change)}"
    if beyond > 0:
        words += f", and the outermost nodes stand for directions beyond them ({percent(beyond)})"
    if noise > 0.1 * error:
        words += f", beside {percent(noise)} of noise in the readings"
    return Resolution(error if change <= RESOLVED else math.inf, words)


def _of_grid(table: Table, scene: SceneValues, rms: float) -> Resolution:
    thinning = Thinning(whole_grid(table), scene)
    halved, quartered = (c / rms for c in _changes(thinning))
    # The noise of an interpolated value hardly depends on the step of the nodes: of a large table some tell it.
    some = coarse_table(table, NOISE_READINGS) if is_stored(table) else table
    grid = thinning.grid if some is table else whole_grid(some)
    noise = _noise(grid, thinning.pairs, _uncertainty(some, grid), table.u_f is not None) / rms
    if table.u_f is not None:
        # What is noise changes by as much whatever the step.
        halved, quartered = (
            np.sqrt(np.maximum(c**2 - n**2, 0.1 * n**2)) for c, n in zip((halved, quartered), noise[1:], strict=True)
        )
    ratio = halved / quartered if quartered > 0 else 1.0
    factor = MOST if ratio >= MOST / (1 + MOST) else max(LEAST, ratio / (1 - ratio))
    isolation = _isolation(table.layout)
    if isolation > ISOLATED:
        words = (
            f"an axis has a step {isolation:.2g} times as wide as those beside it, and nothing tells what lies in there"
        )
        return Resolution(math.inf, words)
    factor = max(factor, MOST * isolation)
    return _judged(float(halved), factor, _beyond(thinning) / rms, float(noise[0]))


def whole_grid(table: Table) -> StartGrid:
    """All nodes of a table; of one with stored cells none is read yet."""
    if is_stored(table):
        return StartGrid(table.layout, table.f, ValidCells(table.f, table.flag))
    f = np.asarray(table.f[...], float)
    valid = (np.asarray(table.flag[...]) == Flag.VALID) & np.isfinite(f)
    return StartGrid(table.layout, np.where(valid, f, 0.0), valid)


def _every(count: int, step: int, first: int) -> np.ndarray:
    return np.arange(first, count, step) if count > first else np.arange(count)


def _changes(thinning: Thinning) -> tuple[float, float]:
    """rms radiance by which every second node differs from all, and every fourth from every second, at the worst.

    Of all axes together and of each alone: what one axis misses may hide what another does.
    """
    shape, rms = thinning.grid.layout.shape, thinning.pairs.rms
    axes = range(len(shape))
    halved = quartered = 0.0
    for chosen, first in itertools.product((axes, *((k,) for k in axes)), (0, 1)):
        half, quarter = (
            thinning.values(tuple(_every(n, step if k in chosen else 1, first if k in chosen else 0)
                                  for k, n in enumerate(shape)))
            for step in (2, 4)
        )  # fmt: skip
        halved = max(halved, rms(half - thinning.truth))
        quartered = max(quartered, rms(quarter - half))
    return halved, quartered


def _uncertainty(table: Table, grid: StartGrid) -> np.ndarray:
    """Standard uncertainties of the readings: the stored ones, else what each is off its neighbours on an axis.

    Of the axes that where the readings vary least from node to node.
    """
    values, known = grid.arrays
    if table.u_f is not None:
        return np.where(known, np.nan_to_num(np.asarray(table.u_f[...], float), posinf=0.0), 0.0)
    least, smallest = np.zeros(values.shape), math.inf
    for k, count in enumerate(grid.layout.shape):
        if count < 3:
            continue
        f, valid = (np.moveaxis(a, k, 0) for a in (values, known))
        off = np.where(valid[:-2] & valid[1:-1] & valid[2:], f[1:-1] - (f[:-2] + f[2:]) / 2, 0.0)
        u = np.abs(np.concatenate([off[:1], off, off[-1:]])) / math.sqrt(1.5)
        total = float(np.sum(u**2))
        if total < smallest:
            least, smallest = np.moveaxis(u, 0, k), total
    return least


def _noise(grid: StartGrid, pairs: ScenePairs, u: np.ndarray, stored: bool) -> np.ndarray:
    """rms radiance of the noise of the readings, and of the changes that it makes, by draws of their uncertainties."""
    scene = SceneValues(pairs, np.zeros((pairs.view.size, u.shape[-1])))
    largest, changes = 0.0, np.zeros(2)
    for draw in range(DRAWS if u.any() else 0):
        noisy = Thinning(dataclasses.replace(grid, f=u * np.random.default_rng(draw).standard_normal(u.shape)), scene)
        noisy.truth = noisy.values(grid.nodes)
        largest = max(largest, scene.pairs.rms(noisy.truth))
        if stored and draw == 0:
            changes = np.array(_changes(noisy))
    return np.array([largest, *changes])


def _isolation(layout: Layout) -> float:
    """The largest ratio of a step to the wider of those beside it, of axes with uneven steps; 0 of even ones.

    Leaving out nodes widens such a step by little, and shows little of what it hides.
    """
    largest = 0.0
    for name in layout.axes:
        steps = np.diff(np.asarray(interpolation_axis(layout, name).nodes))
        if steps.size > 1 and steps.max() > UNEVEN * steps.min():
            beside = np.maximum(np.append(steps[1:], 0.0), np.append(0.0, steps[:-1]))
            largest = max(largest, float((steps / beside).max()))
    return largest


def _beyond(thinning: Thinning) -> float:
    """rms radiance by which f changes within the outermost nodes, as far as the scene goes beyond them."""
    layout, total = thinning.grid.layout, 0.0
    for k, (name, nodes) in enumerate(layout.axes.items()):
        if layout.periods[name] is not None or name in layout.mirrored_axes or nodes.size == 1:
            continue
        x = np.asarray(thinning.coordinates[name])
        for past, within in ((nodes[0] - x, nodes - nodes[0]), (x - nodes[-1], nodes[-1] - nodes)):
            outside = past > 1e-9
            if outside.any():
                kept = np.flatnonzero(within >= past.max())
                kept = kept if kept.size else np.array([np.argmax(within)])
                shorter = thinning.values(tuple(kept if j == k else n for j, n in enumerate(thinning.grid.nodes)))
                total += thinning.pairs.rms((shorter - thinning.truth) * outside[:, None])
    return total
