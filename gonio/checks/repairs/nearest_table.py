"""`repair`: the nearest table that is reciprocal and conserves energy, both at once."""

import dataclasses
import datetime
from typing import Any

import numpy as np
from scipy import sparse

from gonio.checks.certificate import Certificate
from gonio.checks.repairs.albedo_rows import albedo_rows
from gonio.checks.repairs.projection import Projection, nearest
from gonio.checks.table.evidence import LEVEL
from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import Table, whole_table_of_values
from gonio.models.display import Displayed
from gonio.models.errors import GonioError

MOST_VALUES = 60_000_000
"""Readings of a table that are held in memory at once."""

DARK = 1e-3
"""Relative weights do not grow below this share of the mean reading."""

ROOM = 1e-6
"""Albedos are held this far below 1: single precision may store the table."""


@dataclasses.dataclass(repr=False)
class Repaired(Displayed):
    """A repaired table, certificates before and after, and how far its readings moved (`moved`, JSON-able)."""

    table: Table
    before: Certificate
    after: Certificate
    moved: dict[str, Any]
    remark: str = ""
    """What a user should know: that the table was first read on a grid, say."""

    def facts(self) -> dict[str, str]:
        """The verdicts before and after, and how far the readings moved."""
        return {
            "table": f"{self.table.name}{', ' * bool(self.remark)}{self.remark}",
            "verdict": f"{self.before.overall} before, {self.after.overall} after",
            "moved": f"{self.moved['readings']:,} readings by {self.moved['relative_rms']:.2%} (rms)",
        }


def repair(
    table: SubjectLike,
    *,
    nonnegative: bool = False,
    tolerances: dict[str, float] | None = None,
    feature_width: float = 0.0,
    level: float = LEVEL,
    step: float | None = None,
) -> Repaired:
    """The table nearest to `table` whose pairs are equal and whose albedos, as its grid integrates them, are at most 1.

    Distance is in units of the stored uncertainties, or, where those are not known, of each pair's mean reading. Only
    valid readings move; `nonnegative` lets none be negative either. A table that brings its own interpolant (RGL's) is
    first read on an isotropic grid of `step` degrees (5). `tolerances`, `feature_width` and `level` are those of the
    certificates (see `gonio.check`). What the grid does not resolve stays undecided in them: no repair can know it.

    Raises GonioError for what is not a table, for a scattered table or a grid without reciprocal pairs, for one
    without valid readings, and for more readings than memory holds.
    """
    from gonio.checks.certify import check

    table, remark = _on_a_grid(_table(table), step)
    f = np.array(table.f[...], dtype=float)
    valid = np.asarray(table.flag[...]) == Flag.VALID
    if not valid.any():
        raise GonioError("the table holds no valid reading; there is nothing to repair")

    def certified(t: Table) -> Certificate:
        return check(t, tolerances=tolerances, feature_width=feature_width, level=level, name=t.name or "table")

    before = certified(table)  # refuses wrong tolerances and levels before there is work to lose
    u = np.full(f.shape, np.nan) if table.u_f is None else np.asarray(table.u_f[...], float)
    cells = np.arange(table.layout.size)
    partner = _partners(table, cells)
    new_f, new_u, runs = f.copy().reshape(cells.size, -1), u.copy().reshape(cells.size, -1), []
    for c in range(f.shape[-1]):
        run = _Channel(table, c, f[..., c].ravel(), u[..., c].ravel(), valid[..., c].ravel(), partner)
        runs.append(run.solve(nonnegative))
        new_f[:, c], new_u[:, c] = run.spread(runs[-1].point, new_f[:, c]), run.uncertainty()
    made = dataclasses.replace(
        table,
        f=new_f.reshape(f.shape).astype(np.asarray(table.f[:0]).dtype),
        u_f=None if table.u_f is None else new_u.reshape(f.shape),
        flag=np.asarray(table.flag[...]),
        interpolant=None,
    )
    moved = _distance(f, np.asarray(made.f, float), u, valid, runs)
    made.provenance = {
        "repaired": {
            "by": "nearest reciprocal table whose albedos are at most 1",
            "nonnegative": nonnegative,
            "moved": moved,
            "remark": remark,
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        },
        "from": table.provenance,
    }
    made.name = f"{table.name} (repaired)".strip()
    return Repaired(made, before, certified(made), moved, remark)


def _table(what: SubjectLike) -> Table:
    what = resolve_subject(what).require_table()
    if what.layout.size * len(what.channels) > MOST_VALUES:
        raise GonioError(
            f"{what.layout.size * len(what.channels):,} readings are more than can be repaired in memory"
            f" (at most {MOST_VALUES:,}); repair a coarser table"
        )
    return what


def _on_a_grid(table: Table, step: float | None) -> tuple[Table, str]:
    if table.interpolant is None:
        if not table.layout.gridded:
            raise GonioError("scattered readings have no pairs to be made equal; measure them on a grid first")
        if step is not None:
            raise GonioError("the table has a grid of its own and is repaired on that; leave the step out")
        return table, ""
    step = 5.0 if step is None else step
    if not 1 <= step <= 15:
        raise GonioError(f"the step is {step:g}°; give 1 to 15 degrees")
    from gonio.data.tabulate import grid_values

    polar = np.radians(np.arange(0, 85 + 1e-9, step))
    layout = layouts.isotropic(polar, polar, np.radians(np.arange(0, 360 - 1e-9, step)))
    read = whole_table_of_values(
        layout, grid_values(table.interpolant(), layout), table.channels, name=table.name, provenance=table.provenance
    )
    return read, f"first read by the format's own warp on an isotropic grid of {step:g}°"


def _partners(table: Table, cells: np.ndarray) -> np.ndarray:
    layout = table.layout
    partner = layout.exchanged(cells)
    if partner is None:
        return cells
    if np.mean(partner >= 0) < 0.1:
        raise GonioError(
            "its grid holds no reciprocal pairs; measure it with equal polar angles for light and detector"
        )
    return np.where(partner >= 0, partner, cells)


class _Channel:
    """One channel: the numbers that are free are pairs of readings, each with a weight."""

    def __init__(self, table, channel, f, u, valid, partner):
        cells = np.arange(f.size)
        # A reading whose partner is not valid stands alone.
        together = np.where(valid & valid[partner], np.minimum(cells, partner), cells)
        self.cells = cells[valid]
        names, self.group = np.unique(together[valid], return_inverse=True)
        self.rows = albedo_rows(table, channel)[:, self.cells] @ sparse.csr_matrix(
            (np.ones(self.cells.size), (np.arange(self.cells.size), self.group)), shape=(self.cells.size, names.size)
        )
        self.u, own = u, f[valid]
        count = np.bincount(self.group)
        known = np.isfinite(u[valid]) & (u[valid] > 0)
        if known.any():
            self.each = 1 / np.where(known, u[valid], np.median(u[valid][known])) ** 2
        else:
            size = np.bincount(self.group, np.abs(own)) / count
            size = np.maximum(size, max(DARK * np.mean(np.abs(own)), 1e-300))
            self.each = (1 / size**2)[self.group]
        self.weight = np.bincount(self.group, self.each)
        self.mean = np.bincount(self.group, self.each * own) / self.weight

    def solve(self, nonnegative: bool) -> Projection:
        limit = np.full(self.rows.shape[0], 1.0 - ROOM)
        # Weights about 1 keep the dual well scaled.
        return nearest(self.mean, self.weight / np.median(self.weight), self.rows.tocsr(), limit, nonnegative)

    def spread(self, point, into):
        into[self.cells] = point[self.group]
        return into

    def uncertainty(self):
        # Of the weighted mean of the pair; NaN where one of the two is unknown.
        out = self.u.copy()
        variance = np.bincount(self.group, (self.each * self.u[self.cells]) ** 2) / self.weight**2
        out[self.cells] = np.sqrt(variance)[self.group]
        return out


def _distance(f, new, u, valid, runs) -> dict:
    change = np.abs(new - f)[valid]
    own, known = np.abs(f[valid]), np.isfinite(u[valid]) & (u[valid] > 0)
    lit = own > 0
    told = {
        "relative_rms": float(np.sqrt(np.sum(change**2) / np.sum(own**2))) if lit.any() else 0.0,
        "median_relative": float(np.median(change[lit] / own[lit])) if lit.any() else 0.0,
        "percentile_95_relative": float(np.percentile(change[lit] / own[lit], 95)) if lit.any() else 0.0,
        "largest_per_sr": float(change.max()),
        "readings": int(change.size),
        "steps": [run.steps for run in runs],
        "incidences_at_the_limit": [int(np.count_nonzero(run.multipliers)) for run in runs],
        "missed": max(run.missed for run in runs),
    }
    if known.any():
        z = change[known] / u[valid][known]
        told |= {"rms_in_uncertainties": float(np.sqrt(np.mean(z**2))), "share_beyond_2_u": float(np.mean(z > 2))}
    return told
