"""The coarsest table that a scene's tolerance allows: channels, symmetries, layout, nodes and precision."""

import dataclasses
from collections.abc import Callable

import numpy as np

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.interpolation.multilinear import as_material
from gonio.data.layouts import Layout
from gonio.data.reduction.thin_grid import Base, Thinning
from gonio.data.scene import Scene, load_scene
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Channels, Table
from gonio.models.display import Displayed
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import Direction, rotate_z

FEW, PAIRS, CHECKED = 1000, 6000, 30_000  # pairs of directions that guide the search, judge it, and measure its end
HALF_DIFFERENCE = (45, 30, 24)  # nodes of theta_h, theta_d, phi_d where a table is laid out anew
AT_ONCE = 8192
MOST_TURNS = 8  # azimuths of the light over which an anisotropic table is averaged
TIGHTER = (0.97, 0.85, 0.6, 0.3)  # of the tolerance: targets of the search, until the measured error is within it


@dataclasses.dataclass(frozen=True, repr=False)
class Reduction(Displayed):
    """A reduced table, its error as measured against the whole one in the scene, and what was left out, in words."""

    table: Table
    error: float
    tolerance: float
    left_out: tuple[str, ...]
    cells: tuple[int, int]
    """Readings of the whole table, and of the reduced one."""

    def facts(self) -> dict[str, str]:
        """Readings, error and tolerance, and what is left out."""
        return {
            "table": f"{self.table.name}: {self.cells[1]:,} of {self.cells[0]:,} readings",
            "error": f"{self.error:.3g} of the rms radiance; tolerance {self.tolerance:.3g}",
            "left out": "; ".join(self.left_out),
        }


def reduce_table(
    table: SubjectLike,
    scene: "str | Scene",
    tolerance: float | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Reduction:
    """The coarsest table found whose radiance in a scene is within the tolerance (the scene's own if None is given).

    The error is that of the reduced table, interpolated as `multilinear` does, against the whole one as it is
    read, on other directions than the search saw. Uncertainties are not kept. Raises GonioError where the table does
    not answer for what the scene sees, and where no smaller table is within the tolerance.
    """
    table, scene = resolve_subject(table).require_table(), load_scene(scene)
    tolerance = scene.tolerance if tolerance is None else tolerance
    left, whole = [], table
    if (names := scene.channels_of(table.channels.names)) and len(names) < len(table.channels):
        whole = table.only(names)
        left.append(
            f"{len(table.channels) - len(names)} of {len(table.channels)} channels, which the scene does not see"
        )
    truth = as_material(whole)
    few, pairs, check = (scene.pairs(n) for n in (FEW, PAIRS, CHECKED))
    rough, f, checked = (_values(truth, p.wi, p.wo) for p in (few, pairs, check))
    if not (np.isfinite(f).all() and np.isfinite(checked).all()):
        raise GonioError(
            f"{table.name or 'the table'} does not answer for all directions that the scene sees (an in-plane table "
            "knows nothing out of its plane); give another scene, or reduce a table of the whole hemisphere"
        )
    if pairs.rms(f) == 0:
        raise GonioError(f"{table.name or 'the table'} is dark in the scene '{scene.name}': there is no error to allow")
    for share in TIGHTER:
        found = _search(whole, truth, (pairs, f), (few, rough), share * tolerance, say)
        if found is None:
            break
        base, kept, grey = found
        reduced = _built(whole, base, kept, grey)
        again = _values(as_material(reduced), check.wi, check.wo)
        error = check.error(np.broadcast_to(again, checked.shape), checked)
        if error <= tolerance:
            counts = (table.layout.size * len(table.channels), reduced.layout.size * len(reduced.channels))
            if reduced.f.nbytes + reduced.flag.nbytes >= _bytes(table):
                break
            return Reduction(reduced, error, tolerance, tuple(left + _words(whole, base, kept, grey)), counts)
    raise GonioError(
        f"no smaller table than {table.name or 'this one'} is within {100 * tolerance:g} % of it in the scene "
        f"'{scene.name}'; allow a larger tolerance, or keep the table"
    )


def _values(material, wi: Direction, wo: Direction) -> np.ndarray:
    """f (n, C) of any number of pairs by calls of one size: a size of its own for each would compile once more."""
    n, parts = wi.z.size, []
    for start in range(0, n, AT_ONCE):
        at = np.minimum(np.arange(start, start + AT_ONCE), n - 1)
        f = evaluate(material, *(Direction(*(np.asarray(c)[at] for c in w)) for w in (wi, wo)))
        parts.append(np.asarray(f).reshape(AT_ONCE, -1)[: n - start])
    return np.concatenate(parts)


def _bytes(table: Table) -> int:
    return sum(
        np.dtype(a.dtype).itemsize * int(np.prod(a.shape)) for a in (table.f, table.flag, table.u_f) if a is not None
    )


def _search(whole: Table, truth, seen: tuple, guide: tuple, tolerance: float, say):
    best, least = None, None
    for base in bases(whole, truth):
        for grey in (True, False) if seen[1].shape[1] > 1 else (False,):
            one = dataclasses.replace(base, f=_greyed(base), valid=base.valid.all(-1, keepdims=True)) if grey else base
            thinning = Thinning(one, *seen, guide=Thinning(one, *guide))
            kept = thinning.thin(tolerance)
            if kept is None:
                continue
            size = int(np.prod([k.size for k in kept])) * one.f.shape[-1]
            say(f"{', '.join(base.done) or base.layout.name}{', grey' if grey else ''}: {size} values")
            if least is None or size < least:
                best, least = (one, kept, grey), size
            if grey:
                break
    return best


def _greyed(base: Base) -> np.ndarray:
    return np.mean(np.where(base.valid, base.f, 0.0), axis=-1, keepdims=True)


def bases(table: Table, truth) -> list[Base]:
    """The grids that a table can be thinned from: its own, less its symmetries, and in half/difference angles.

    What the surface does not show is not assumed: a symmetry that it breaks costs its error in the scene.
    """
    found = []
    own = table.layout if table.layout.gridded and table.interpolant is None else None
    if own is not None:
        f = np.asarray(table.f[...], float)
        found.append(Base(own, f, (np.asarray(table.flag[...]) == Flag.VALID) & np.isfinite(f)))
    turning = own is None or own.has_azimuth_of_light
    outgoing = None if own is None else own.outgoing_grid()
    if outgoing is not None and turning:
        grid = layouts.isotropic(outgoing.theta_i, outgoing.theta_o, outgoing.azimuth)
        found.append(_sampled(truth, grid, ("isotropy",), outgoing.phi_i))
    if outgoing is not None:
        flat = found[-1].layout
        phi = flat.axes["delta_phi"]
        if phi[-1] > np.pi * (1 + 1e-9):
            folded = np.unique(np.round(np.append(phi[phi <= np.pi], np.pi), 12))
            grid = layouts.isotropic(flat.axes["theta_i"], flat.axes["theta_o"], np.minimum(folded, np.pi))
            done = (*found[-1].done, "bilateral symmetry")
            found.append(_sampled(truth, grid, done, outgoing.phi_i, mirrored=True))
    if turning or outgoing is not None:
        turns = np.linspace(0, 2 * np.pi, MOST_TURNS, endpoint=False) if turning else np.zeros(1)
        grid = layouts.merl("lower", HALF_DIFFERENCE)
        done = (*(("isotropy",) if turning else ()), "bilateral symmetry", "half/difference angles", "reciprocity")
        found.append(_sampled(truth, grid, done, turns, mirrored=True, swapped=True))
    elif own.in_half_vectors and not own.reciprocal_by_construction:
        phi_d = own.axes["phi_d"]
        grid = layouts.half_difference(own.axes["theta_h"], own.axes["theta_d"], phi_d[phi_d < np.pi - 1e-9])
        found.append(_sampled(truth, grid, ("reciprocity",), np.zeros(1), swapped=True))
    return found


def _sampled(truth, grid: Layout, done, turns, mirrored: bool = False, swapped: bool = False) -> Base:
    """A grid of the mean of the whole table over azimuths of the light, mirror images and exchanged directions."""
    wi, wo = grid.directions()
    above = grid.above_horizon()
    wi, wo = (Direction(*(np.where(above, c, up) for c, up in zip(w, (0.0, 0.0, 1.0), strict=True))) for w in (wi, wo))
    total, number = 0.0, 0
    picked = turns[:: max(1, -(-len(turns) // MOST_TURNS))]
    for phi in picked:
        for mirror in (1, -1) if mirrored else (1,):
            a, b = (rotate_z(Direction(w.x, mirror * w.y, w.z), np.cos(phi), np.sin(phi)) for w in (wi, wo))
            for one, other in ((a, b), (b, a)) if swapped else ((a, b),):
                total, number = total + _values(truth, one, other), number + 1
    f = (total / number).reshape(*grid.shape, -1)
    valid = np.broadcast_to(above.reshape(*grid.shape, 1), f.shape)
    return Base(grid, f, valid, done)


def _built(whole: Table, base: Base, kept, grey: bool) -> Table:
    at = np.ix_(*kept)
    axes = {n: a[k] for (n, a), k in zip(base.layout.axes.items(), kept, strict=True)}
    layout = base.layout.with_axes(axes)
    valid = base.valid[at]
    f = np.where(valid, base.f[at], np.nan).astype(np.float32)
    flag = np.where(valid, np.uint8(Flag.VALID), np.uint8(Flag.NOT_MEASURED))
    flag[~layout.above_horizon().reshape(layout.shape)] = Flag.BELOW_HORIZON
    f[flag != Flag.VALID] = np.nan
    channels = Channels.grey() if grey else whole.channels
    provenance = {**whole.provenance, "reduced": _words(whole, base, kept, grey)}
    return Table(layout, f, flag, channels, provenance=provenance, name=whole.name)


def _words(whole: Table, base: Base, kept, grey: bool) -> list[str]:
    said = []
    if grey:
        said.append(f"colour: one channel in place of {len(whole.channels)}")
    if base.done:
        said.append(f"by {', '.join(base.done)}")
    for (name, axis), k in zip(base.layout.axes.items(), kept, strict=True):
        low, high = np.degrees(axis[k[[0, -1]]])
        if k.size < axis.size:
            said.append(f"{name}: {k.size} of {axis.size} nodes, {low:.4g}° to {high:.4g}°")
    if np.asarray(whole.f[:0]).dtype != np.float32:
        said.append("single precision")
    if whole.u_f is not None:
        said.append("standard uncertainties")
    return said
