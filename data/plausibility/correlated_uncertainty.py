"""How much of their stored uncertainties readings share, as far as their scatter shows it.

Laboratories state what a reading may be off, calibration and all. Neighbouring readings that scatter far less than
that do not err independently: the rest is alike in all of them, and no mean over readings makes it smaller.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from gonio.data.flags import Flag
from gonio.data.plausibility.neighbours import cubic_weights, windows
from gonio.data.table import Table

WINDOWS = 512
"""Of readings that are compared, of each kind; of more, a random choice."""
FEWEST = 50
"""Windows below which their scatter says nothing."""
MEDIAN = 0.4549364
"""Of χ² with one degree of freedom."""
INDEPENDENT = 0.25
"""Variance of the scatter over the stored one, from which on the readings are taken as independent."""
LARGEST = 0.3
"""Relative uncertainty of readings whose logarithms are compared."""
COPIED = 1e-6
"""Relative difference of pairs below which one was made from the other, or both from one mean."""


class CorrelatedUncertainty(NamedTuple):
    """What readings share of their stored uncertainties.

    `scatter`: share of these by which bright readings scatter at most. `relative`: relative standard uncertainty of all
    readings together by the rest of it; 0 where the readings scatter as stated, or where nothing shows.
    """

    scatter: float
    relative: float

    def independent(self, f: np.ndarray, u_f: np.ndarray) -> np.ndarray:
        """What is left of uncertainties u_f of readings f for each reading by itself, 1/sr, of the same shape.

        Dark readings, whose stored uncertainty is more than the share of f, keep the rest of it.
        """
        rest = np.maximum(u_f**2 - (self.relative * f) ** 2, (self.scatter * u_f) ** 2)
        return np.sqrt(rest)


NOTHING = CorrelatedUncertainty(1.0, 0.0)


def correlated_uncertainty(table: Table) -> CorrelatedUncertainty:
    """What all readings of a table share of `u_f`, from how far each is off what others say that it is.

    These are a cubic through its four neighbours, and on grids the readings of the mirrored and of the exchanged
    directions. What f bends, or differs by, counts as scatter. The brighter half of them tells: dark readings have
    noise of their own. Tables of a simulated instrument state their common errors apart; theirs are independent.
    """
    if table.u_f is None or "instrument" in table.provenance or table.interpolant is not None:
        return NOTHING
    best = NOTHING
    rows = [(cells, cubic_weights(places)) for cells, places in windows(table, 5, WINDOWS, 5)]
    for cells, weight in [*rows, *_equal_pairs(table)]:
        if cells.shape[0] < FEWEST:
            continue
        known = _scatter(table, cells, weight)
        if known is not None and known.scatter < best.scatter:
            best = known
    return best if best.scatter**2 < INDEPENDENT else NOTHING


def with_scatter(table: Table, known: CorrelatedUncertainty) -> Table:
    """The table with the uncertainties that are independent from reading to reading."""
    if table.u_f is None or not known.relative:
        return table
    f, u_f = (np.asarray(a[...], float) for a in (table.f, table.u_f))
    return dataclasses.replace(table, u_f=known.independent(f, u_f))


def _equal_pairs(table: Table) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pairs of cells (K, 2) that are equal on a symmetric surface, and on a reciprocal one, and their weights."""
    layout, pairs = table.layout, []
    if not layout.gridded:
        return []
    most = 4 * WINDOWS
    cells = np.arange(layout.size) if layout.size <= most else np.random.default_rng(1).integers(layout.size, size=most)
    for related in (layout.mirrored, layout.exchanged):
        if (partner := related(cells)) is None:
            continue
        use = np.flatnonzero(partner > cells)[:WINDOWS]
        pairs.append((np.stack([cells[use], partner[use]], axis=1), np.tile([1.0, -1.0], (use.size, 1))))
    return pairs


def _scatter(table: Table, cells: np.ndarray, weight: np.ndarray) -> CorrelatedUncertainty | None:
    """The same of readings (K, m) whose logarithms' weighted sum is about 0, None where too few say anything."""
    block = table.values_at(cells.ravel())
    f, u = (np.asarray(block[name], float).reshape(*cells.shape, -1) for name in ("f", "u_f"))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = u / f
        use = (np.asarray(block["flag"]).reshape(f.shape) == Flag.VALID) & (relative > 0) & (relative < LARGEST)
        use = use.all(axis=1) & (f > 0).all(axis=1)
        off = np.einsum("kj,kjc->kc", weight, np.log(np.maximum(f, 1e-300)))
        ratio = off**2 / np.einsum("kj,kjc->kc", weight**2, relative**2)
    use &= np.isfinite(ratio)
    if use.any():
        use &= f[:, 0] >= np.median(f[:, 0][use])
    if np.count_nonzero(use.any(axis=1)) < FEWEST:
        return None
    if weight.shape[1] == 2 and np.median(np.abs(off[use])) < COPIED:
        return None
    variance = float(np.median(ratio[use])) / MEDIAN
    stored = float(np.median(relative[:, 0][use]))
    return CorrelatedUncertainty(float(np.sqrt(variance)), float(np.sqrt(max(1.0 - variance, 0.0))) * stored)
