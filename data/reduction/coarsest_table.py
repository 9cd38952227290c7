"""The coarsest table that a scene's tolerance allows: channels, symmetries, layout, nodes and precision."""

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.interpolation.multilinear import as_material, with_light_at_x
from gonio.data.layouts.base import Layout
from gonio.data.reduction.judge import Judge
from gonio.data.reduction.stacked_sides import StackedSides
from gonio.data.reduction.stored_cells import coarse_table, is_stored, some_channels, with_stored_cells
from gonio.data.reduction.table_resolution import Resolution, whole_grid
from gonio.data.reduction.thin_grid import SceneValues, StartGrid, Thinning, interpolated
from gonio.data.scene import Scene, ScenePairs, load_scene
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Channels, Table, index_of
from gonio.models.brdf import AbstractBRDF
from gonio.models.deprecation import old_keywords
from gonio.models.display import Displayed, percent
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import NORMAL, Direction, rotate_z
from gonio.models.geometry.sides import FRONT

RANKING, SEARCH, CHECK = 1000, 6000, 30_000  # pairs of directions that rank nodes, judge trials, and measure the error
HALF_DIFFERENCE = (45, 30, 24)  # nodes of theta_h, theta_d, phi_d where a table is laid out anew
MAX_TURNS = 8  # azimuths of the light over which an anisotropic table is averaged
STARTS = (1 << 21, 1 << 24)  # readings from which the search begins, of a table larger than memory
ISOTROPY, BILATERAL, RECIPROCITY = "isotropy", "bilateral symmetry", "reciprocity"
SHARED = (1.0, 0.6)  # of the tolerance: for each pair of sides, until that of their sum is kept
TIGHTER = (0.97, 0.85, 0.6, 0.3)  # of the tolerance: targets of the search, until the measured error is within it


@dataclasses.dataclass(frozen=True, repr=False)
class Reduction(Displayed):
    """A reduced table, its errors in the scene, relative to the rms radiance, and what was left out, in words."""

    table: Table
    error: float
    """Against the whole table."""
    whole: Resolution
    """That of the whole table against the surface."""
    promised: float
    """Bound on the error of the reduced table against the surface; infinite where the whole one resolves nothing."""
    tolerance: float
    left_out: tuple[str, ...]
    cells: tuple[int, int]
    """Readings of the whole table, and of the reduced one."""

    @property
    def keeps(self) -> bool:
        """Whether the reduced table is within the tolerance of the surface itself."""
        return self.promised <= self.tolerance

    @property
    def exit_status(self) -> int:
        """0 where the tolerance is kept, else 1."""
        return 0 if self.keeps else 1

    def facts(self) -> dict[str, str]:
        """Readings, errors and tolerance, and what is left out."""
        return {
            "table": f"{self.table.name}: {self.cells[1]:,} of {self.cells[0]:,} readings",
            "error": f"{self.error:.3g} of the rms radiance against the whole table; tolerance {self.tolerance:.3g}",
            "promised": self.promise(),
            "left out": "; ".join(self.left_out),
        }

    def promise(self) -> str:
        """What is promised of the error against the surface itself, and why no more, as one sentence."""
        kept, (error, reason) = f"the tolerance of {percent(self.tolerance, 3)}", self.whole
        if self.keeps:
            return f"at most {percent(self.promised)} off the surface itself, within {kept}: {reason}"
        if not math.isfinite(error):
            return f"{kept} is not promised: the whole table does not resolve the scene; {reason}"
        if error > self.tolerance:
            words = f"the whole table is itself up to {percent(error)} off the surface"
        else:
            words = f"the reduced one may be {percent(self.promised)} off the surface"
        return f"{kept} is not promised: {words}; {reason}"


@old_keywords(say="log")
def reduce_table(
    table: SubjectLike,
    scene: str | Scene,
    tolerance: float | None = None,
    log: Callable[[str], None] = lambda line: None,
) -> Reduction:
    """The coarsest table found whose radiance in a scene is within the tolerance of the surface's.

    The error is measured on other directions than those of the search: against the material that the provenance names,
    else against the whole table, whose own error is estimated (`resolution`) and leaves that much less to the reduced
    one. Where the whole table is beyond the tolerance, the reduced one is within it of the whole. Uncertainties are not
    kept.

    Of a table with readings behind the sample the scene sees each pair of sides by itself, lights and views mirrored
    into the front: what goes through as if the scene's light stood behind. All keep the tolerance on one grid; with
    lights or views behind the sample, so does the radiance that they make together.

    Args:
        table: a table, or the path of one in any format that can be read.
        scene: a scene, its file, or the name of a shipped one.
        tolerance: rms error of the radiance over its rms; the scene's own if None.
        log: called with a line for each grid that was thinned.

    Returns:
        The table with what is promised of it; `keeps` says whether that is the tolerance.

    Raises:
        GonioError: the table does not answer for what the scene sees, or no smaller table is within the tolerance.
    """
    table, scene = resolve_subject(table, blockwise=True).require_table(), load_scene(scene)
    tolerance = scene.tolerance if tolerance is None else tolerance
    scene.require_sides(table.sides if scene.sides != FRONT else FRONT, table.name or "the table")
    if table.sides != FRONT:
        return _reduced_sides(table, scene, tolerance, log)
    return _coarsest(with_stored_cells(table), scene, tolerance, log)


def _reduced_sides(table: Table, scene: Scene, tolerance: float, log: Callable[[str], None]) -> Reduction:
    """That of a table with readings behind the sample: one grid for all pairs of sides, which the scene sees folded."""
    names = scene.channels_of(table.channels.names)
    stacked, uncoloured = StackedSides.of(table if names is None else table.only(names)), replace(scene, channels=None)
    for share in SHARED if scene.sides != FRONT else SHARED[:1]:
        reduced = _coarsest(stacked.table, uncoloured, share * tolerance, log, len(stacked.sides))
        if scene.sides == FRONT:
            break
        reduced = _together(reduced, stacked, scene, tolerance)
        if reduced.keeps or not reduced.whole.error <= tolerance:
            break
    left_out = reduced.left_out
    if names is not None and len(names) < len(table.channels):
        count = len(table.channels)
        left_out = (f"{count - len(names)} of {count} channels, which the scene does not see", *left_out)
    whole_cells = table.layout.size * len(table.channels)
    unstacked = stacked.unstacked(reduced.table)
    return replace(reduced, table=unstacked, left_out=left_out, cells=(whole_cells, reduced.cells[1]))


def _together(reduced: Reduction, stacked: StackedSides, scene: Scene, tolerance: float) -> Reduction:
    """The reduction with its errors in the radiance of a scene that all pairs of sides make together."""
    whole, pairs = stacked.whole, scene.pairs(CHECK, index_of(stacked.whole))
    f, thinned = (
        evaluate_in_blocks(as_material(t), pairs.wi, pairs.wo) for t in (whole, stacked.unstacked(reduced.table))
    )
    judge = Judge.of(whole, SceneValues(pairs, f), tolerance)
    error, promised = judge.errors(np.broadcast_to(thinned, f.shape))
    return replace(reduced, error=error, whole=judge.whole, promised=promised, tolerance=tolerance)


def _coarsest(table: Table, scene: Scene, tolerance: float, log: Callable[[str], None], parts: int = 1) -> Reduction:
    """The reduction; of `parts` groups of channels each keeps the tolerance, and no grid mixes them."""
    whole, left_out = table, ()
    if (names := scene.channels_of(table.channels.names)) and len(names) < len(table.channels):
        whole, count = some_channels(table, names), len(table.channels)
        left_out = (f"{count - len(names)} of {count} channels, which the scene does not see",)
    values_of = interpolant_of(whole)
    ranking, search, check = (
        SceneValues(pairs, values_of(pairs))
        for pairs in (scene.pairs(count, index_of(whole)).mirrored() for count in (RANKING, SEARCH, CHECK))
    )
    _require_values(table, scene, search, check)
    judge = Judge.of(whole, check, tolerance, parts)
    weight = _balance(search, parts)
    search, ranking = (s._replace(f=s.f * weight) for s in (search, ranking))
    judged = _Judged(whole, search, ranking, judge, weight)
    for start in starts_of(whole, ranking):
        reduction = _within(judged, start, _bytes(table), log)
        if reduction is not None:
            cells = (table.layout.size * len(table.channels), reduction.cells[1])
            return replace(reduction, left_out=(*left_out, *reduction.left_out), cells=cells)
    of = f"{percent(tolerance, 3)} of " + ("the surface" if judge.keeps else "it")
    itself = f", and the whole one is up to {percent(judge.whole.error)} off the surface" if judge.keeps else ""
    raise GonioError(
        f"no smaller table than {table.name or 'this one'} is within {of} in the scene '{scene.name}'{itself}; "
        "allow a larger tolerance, or keep the table"
    )


class _Judged(NamedTuple):
    """A whole table, its values in a scene by which trials are judged, and the weights of its channels."""

    whole: Table
    search: SceneValues
    ranking: SceneValues
    judge: Judge
    weight: np.ndarray


def _within(judged: _Judged, start: Table, most: int, log: Callable[[str], None]) -> Reduction | None:
    """The smallest reduction within the tolerance, thinned from the nodes of `start`, of less than `most` bytes."""
    whole, search, ranking, judge, weight = judged
    parts, tolerance = judge.parts, judge.tolerance
    grids = [
        replace(g, f=np.asarray(g.f) * weight) if parts > 1 else g
        for g in start_grids(with_light_at_x(start), as_material(start))
        if parts == 1 or not g.layout.in_half_vectors
    ]
    pairs = judge.check.pairs
    for share in TIGHTER:
        thinned = _smallest(grids, search, ranking, share * judge.allowed, log, grey=parts == 1)
        if thinned is None:
            return None
        if parts > 1:
            thinned = replace(thinned, f=np.asarray(thinned.f) / weight)
        reduced, words = _reduced(whole, thinned)
        f = evaluate_in_blocks(as_material(reduced), pairs.wi, pairs.wo)
        error, promised = judge.errors(np.broadcast_to(f, judge.check.f.shape))
        if error <= tolerance and (promised <= tolerance or not judge.keeps):
            if reduced.f.nbytes + reduced.flag.nbytes >= most:
                return None
            if start.layout.shape != whole.layout.shape:
                words = [_before_the_search(whole, start), *words]
            cells = (whole.layout.size * len(whole.channels), reduced.layout.size * len(reduced.channels))
            return Reduction(reduced, error, judge.whole, promised, tolerance, tuple(words), cells)
    return None


def starts_of(whole: Table, ranking: SceneValues) -> Iterator[Table]:
    """The tables from whose nodes a search begins: the whole one, or some nodes of one too large for memory."""
    if not is_stored(whole):
        yield whole
        return
    trials, values = Thinning(whole_grid(whole), ranking), replace(whole, u_f=None)
    for readings in STARTS:
        yield coarse_table(values, readings, trials.error)


def _before_the_search(whole: Table, start: Table) -> str:
    counts = zip(whole.layout.axes, start.layout.shape, whole.layout.shape, strict=True)
    return f"large, so thinned evenly before the search: {', '.join(f'{n} {a} of {b}' for n, a, b in counts)} nodes"


def interpolant_of(whole: Table) -> Callable[[ScenePairs], np.ndarray]:
    """What gives f (N, C) of a table at a scene's pairs; of one too large for memory from the cells that these need."""
    if is_stored(whole):
        return lambda pairs: interpolated(whole_grid(whole), pairs)
    interpolant = as_material(whole)
    return lambda pairs: evaluate_in_blocks(interpolant, pairs.wi, pairs.wo)


def _balance(scene: SceneValues, parts: int) -> np.ndarray:
    """Weights (C,) that make groups of channels equally bright in a scene: faint ones count as much as bright ones."""
    groups = np.array_split(scene.f, parts, axis=1)
    bright = [scene.pairs.rms(f) for f in groups]
    most = max(bright)
    each = [most / b if parts > 1 and b > 0 else 1.0 for b in bright]
    return np.repeat(each, [f.shape[1] for f in groups])


def _require_values(table: Table, scene: Scene, search: SceneValues, check: SceneValues) -> None:
    name = table.name or "the table"
    if not (np.isfinite(search.f).all() and np.isfinite(check.f).all()):
        raise GonioError(
            f"{name} does not answer for all directions that the scene sees (an in-plane table "
            "knows nothing out of its plane); give another scene, or reduce a table of the whole hemisphere"
        )
    if search.pairs.rms(search.f) == 0:
        raise GonioError(f"{name} is dark in the scene '{scene.name}': there is no error to allow")


def _bytes(table: Table) -> int:
    arrays = (a for a in (table.f, table.flag, table.u_f) if a is not None)
    return sum(np.dtype(a.dtype).itemsize * int(np.prod(a.shape)) for a in arrays)


def _reduced(whole: Table, thinned: StartGrid) -> tuple[Table, list[str]]:
    """The table of a thinned grid, single precision, and what of the whole one it leaves out, in words."""
    layout, (f, valid) = thinned.layout, thinned.arrays
    flag = np.where(valid, np.uint8(Flag.VALID), np.uint8(Flag.NOT_MEASURED))
    flag[~layout.readable().reshape(layout.shape)] = Flag.BELOW_HORIZON
    f = np.where(flag == Flag.VALID, f, np.nan).astype(np.float32)
    words = [f"by {', '.join(thinned.simplified_by)}"] if thinned.simplified_by else []
    words += thinned.left_out
    words += ["single precision"] if np.dtype(whole.f.dtype) != np.float32 else []
    words += ["standard uncertainties"] if whole.u_f is not None else []
    channels = Channels.grey() if f.shape[-1] < len(whole.channels) else whole.channels
    return Table(layout, f, flag, channels, provenance=whole.provenance | {"reduced": words}, name=whole.name), words


def _smallest(
    grids: Sequence[StartGrid],
    search: SceneValues,
    ranking: SceneValues,
    tolerance: float,
    log: Callable[[str], None],
    grey: bool = True,
) -> StartGrid | None:
    """The smallest of the thinned grids, grey ones before coloured ones; None where none is within the tolerance."""
    smallest = None
    for grid in grids:
        for colourless in (True, False) if grey and search.f.shape[1] > 1 else (False,):
            start = grid.grey() if colourless else grid
            nodes = Thinning(start, search, ranking).thin(tolerance)
            if nodes is None:
                continue
            thinned = start.part(nodes)
            names = ", ".join(grid.simplified_by) or grid.layout.name
            log(f"{names}{', grey' if colourless else ''}: {thinned.size} values")
            if smallest is None or thinned.size < smallest.size:
                smallest = thinned
            if colourless:
                break
    return smallest


def start_grids(table: Table, truth: AbstractBRDF) -> list[StartGrid]:
    """The grids that a table, with the interpolant `truth`, can be thinned from.

    No symmetry is tested beforehand: one that the surface breaks costs its error in the scene.
    """
    grids = []
    layout = table.layout if table.layout.gridded and table.interpolant is None else None
    if layout is not None:
        f = np.asarray(table.f[...], float)
        grids.append(StartGrid(layout, f, (np.asarray(table.flag[...]) == Flag.VALID) & np.isfinite(f)))
    turning = layout is None or layout.has_azimuth_of_light
    isotropy = (ISOTROPY,) if turning else ()
    outgoing = None if layout is None else layout.outgoing_grid()
    if outgoing is not None:
        azimuth = outgoing.azimuth
        if turning:
            grid = layouts.isotropic(outgoing.theta_i, outgoing.theta_o, azimuth)
            grids.append(_averaged(truth, grid, isotropy, outgoing.phi_i))
        if azimuth[-1] > np.pi * (1 + 1e-9):
            half = np.unique(np.round(np.append(azimuth[azimuth <= np.pi], np.pi), 12))
            grid = layouts.isotropic(outgoing.theta_i, outgoing.theta_o, np.minimum(half, np.pi))
            grids.append(_averaged(truth, grid, (*isotropy, BILATERAL), outgoing.phi_i))
    if turning or outgoing is not None:
        turns = np.linspace(0, 2 * np.pi, MAX_TURNS, endpoint=False) if turning else np.zeros(1)
        simplified_by = (*isotropy, BILATERAL, "half/difference angles", RECIPROCITY)
        grids.append(_averaged(truth, layouts.merl("lower", HALF_DIFFERENCE), simplified_by, turns))
    elif layout is not None and layout.in_half_vectors and not layout.reciprocal_by_construction:
        phi_d = layout.axes["phi_d"]
        grid = layouts.half_difference(layout.axes["theta_h"], layout.axes["theta_d"], phi_d[phi_d < np.pi - 1e-9])
        grids.append(_averaged(truth, grid, (RECIPROCITY,), np.zeros(1)))
    return grids


def _averaged(truth: AbstractBRDF, layout: Layout, simplified_by: tuple[str, ...], turns: np.ndarray) -> StartGrid:
    """A grid of the mean of a table over azimuths of the light and what the simplifications take for equal."""
    above = layout.readable()
    wi, wo = (
        Direction(*(np.where(above, c, up) for c, up in zip(w, NORMAL, strict=True))) for w in layout.directions()
    )
    total, number = np.zeros(()), 0
    for phi in turns[:: max(1, -(-len(turns) // MAX_TURNS))]:
        for side in (1, -1) if BILATERAL in simplified_by else (1,):
            a, b = (rotate_z(Direction(w.x, side * w.y, w.z), np.cos(phi), np.sin(phi)) for w in (wi, wo))
            for pair in ((a, b), (b, a)) if RECIPROCITY in simplified_by else ((a, b),):
                total, number = total + evaluate_in_blocks(truth, *pair), number + 1
    f = (total / number).reshape(*layout.shape, -1)
    return StartGrid(layout, f, np.broadcast_to(above.reshape(*layout.shape, 1), f.shape), simplified_by)
