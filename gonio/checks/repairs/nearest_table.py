"""`repair`: the nearest table that is reciprocal and conserves energy, both at once."""

import dataclasses
import datetime
from typing import Any, Self

import numpy as np
from scipy import sparse

from gonio.checks.certificate import Certificate
from gonio.checks.repairs.albedo_rows import albedo_rows
from gonio.checks.repairs.projection import Projection, nearest
from gonio.checks.table.evidence import LEVEL
from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.polarisation import is_polarised
from gonio.data.reflection_only import require_reflection
from gonio.data.subject import SubjectLike, resolve_subject
from gonio.data.table import MEDIA, Table, whole_table_of_values
from gonio.models.display import Displayed, percent
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
            "moved": f"{self.moved['readings']:,} readings by {percent(self.moved['relative_rms'], 3)} (rms)",
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

    Of a table of both sides of a sample pairs are equal over the squared index of the exit's medium, as light from
    behind goes back the way of light from the front, and R + T are at most 1.

    Distance is in units of the stored uncertainties, or, where those are not known, of each pair's mean reading. Only
    valid readings move; `nonnegative` lets none be negative either. A table that brings its own interpolant (RGL's) is
    first read on an isotropic grid of `step` degrees (5). `tolerances`, `feature_width` and `level` are those of the
    certificates (see `gonio.check`). What the grid does not resolve stays undecided in them: no repair can know it.

    Raises GonioError for what is not a table, for a scattered table or a grid without reciprocal pairs, for one
    without valid readings, and for more readings than memory holds.
    """
    from gonio.checks.certify import check

    table = _table(table)
    if table.interpolant is not None:
        require_reflection(table, table.name or "the table", "a repair of a file that interpolates by its own rule")
    if is_polarised(table.channels.names):
        raise GonioError(
            "a repair takes each channel by itself, and polarised ones have their exchanged readings in others; name"
            " the channels otherwise where they are none"
        )
    table, remark = _on_a_grid(table, step)
    readings = [_Channel.of(table, c) for c in range(len(table.channels))]
    if not any(channel.valid.any() for channel in readings):
        raise GonioError("the table holds no valid reading; there is nothing to repair")

    def certified(t: Table) -> Certificate:
        return check(t, tolerances=tolerances, feature_width=feature_width, level=level, name=t.name or "table")

    before = certified(table)  # refuses wrong tolerances and levels before there is work to lose
    partner = _partners(table)
    repaired = [
        channel.repaired(partner, (albedo_rows(table, c) * channel.exit2).tocsr(), nonnegative)
        for c, channel in enumerate(readings)
    ]
    f, u = (np.stack(column, axis=-1).reshape(table.f.shape) for column in (list(zip(*repaired, strict=True)))[:2])
    f = f.astype(np.asarray(table.f[:0]).dtype)
    moved = _distance(readings, f, [run for *_, run in repaired])
    new = dataclasses.replace(
        table,
        f=f,
        u_f=None if table.u_f is None else u,
        flag=np.asarray(table.flag[...]),
        interpolant=None,
        provenance=_provenance(table, moved, nonnegative=nonnegative, remark=remark),
        name=f"{table.name} (repaired)".strip(),
    )
    return Repaired(new, before, certified(new), moved, remark)


def _provenance(table: Table, moved: dict[str, Any], **about: Any) -> dict[str, Any]:
    """That of a repaired table: how it was made, of what, between which media."""
    made = {
        "by": "nearest reciprocal table whose albedos are at most 1",
        **about,
        "moved": moved,
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    media = {MEDIA: table.provenance[MEDIA]} if MEDIA in table.provenance else {}
    return {"repaired": made, "from": table.provenance, **media}


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


def _partners(table: Table) -> np.ndarray:
    """The reciprocal cell of each cell; its own number where there is none."""
    cells = np.arange(table.layout.size)
    partner = table.layout.exchanged(cells)
    if partner is None:
        return cells
    if np.mean(partner >= 0) < 0.1:
        raise GonioError(
            "its grid holds no reciprocal pairs; measure it with equal polar angles for light and detector"
        )
    return np.where(partner >= 0, partner, cells)


@dataclasses.dataclass(frozen=True)
class _Channel:
    """The readings of one channel, (cells,), over the squared index of the medium that the light goes out into."""

    f: np.ndarray
    u: np.ndarray
    valid: np.ndarray
    exit2: np.ndarray

    @classmethod
    def of(cls, table: Table, c: int) -> Self:
        f, u, flag = (values[:, c] for values in table.read_values().values())
        front, behind = (float(n[c]) for n in table.media)
        exit2 = np.where(table.layout.cosines(0, table.layout.size)[1] < 0, behind, front) ** 2
        return cls(np.array(f, float) / exit2, np.array(u, float) / exit2, flag == Flag.VALID, exit2)

    def weights(self, group: np.ndarray) -> np.ndarray:
        """The weight of each valid reading: by its uncertainty, or by the mean size of its pair."""
        f, u = np.abs(self.f[self.valid]), self.u[self.valid]
        known = np.isfinite(u) & (u > 0)
        if known.any():
            return 1 / np.where(known, u, np.median(u[known])) ** 2
        size = np.bincount(group, f) / np.bincount(group)
        return (1 / np.maximum(size, max(DARK * np.mean(f), 1e-300)) ** 2)[group]

    def repaired(
        self, partner: np.ndarray, rows: sparse.csr_array, nonnegative: bool
    ) -> tuple[np.ndarray, np.ndarray, Projection]:
        """(f, u_f) of the nearest lawful readings: the free numbers are pairs, each the weighted mean of two."""
        cells = np.arange(self.f.size)
        # A reading whose partner is not valid stands alone.
        together = np.where(self.valid & self.valid[partner], np.minimum(cells, partner), cells)
        cells = cells[self.valid]
        pairs, group = np.unique(together[self.valid], return_inverse=True)
        each = self.weights(group)
        weight = np.bincount(group, each)
        mean = np.bincount(group, each * self.f[cells]) / weight
        spread = sparse.csr_array((np.ones(cells.size), (np.arange(cells.size), group)), (cells.size, pairs.size))
        limit = np.full(rows.indptr.size - 1, 1.0 - ROOM)
        # Weights about 1 keep the dual well scaled.
        run = nearest(mean, weight / np.median(weight), (rows[:, cells] @ spread).tocsr(), limit, nonnegative)
        f, u = self.f.copy(), self.u.copy()
        f[cells] = run.point[group]
        # NaN where one of the two is unknown.
        u[cells] = np.sqrt(np.bincount(group, (each * self.u[cells]) ** 2) / weight**2)[group]
        return self.exit2 * f, self.exit2 * u, run


def _distance(readings: list[_Channel], f: np.ndarray, runs: list[Projection]) -> dict[str, Any]:
    """How far the readings moved: relative to themselves, in 1/sr, in their uncertainties; and how it was reached."""
    valid = np.stack([c.valid for c in readings], -1)
    before, u = (np.stack([c.exit2 * getattr(c, k) for c in readings], -1) for k in ("f", "u"))
    change = np.abs(f.reshape(before.shape) - before)[valid]
    before, u = np.abs(before[valid]), u[valid]
    known, lit = np.isfinite(u) & (u > 0), before > 0
    relative = change[lit] / before[lit] if lit.any() else np.zeros(1)
    moved = {
        "relative_rms": float(np.sqrt(np.sum(change**2) / np.sum(before**2))) if lit.any() else 0.0,
        "median_relative": float(np.median(relative)),
        "percentile_95_relative": float(np.percentile(relative, 95)),
        "largest_per_sr": float(change.max()),
        "readings": int(change.size),
        "steps": [run.steps for run in runs],
        "incidences_at_the_limit": [int(np.count_nonzero(run.multipliers)) for run in runs],
        "missed": max(run.missed for run in runs),
    }
    if known.any():
        z = change[known] / u[known]
        moved |= {"rms_in_uncertainties": float(np.sqrt(np.mean(z**2))), "share_beyond_2_u": float(np.mean(z > 2))}
    return moved
