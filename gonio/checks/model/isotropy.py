"""Isotropy: does turning both directions about the normal change f? Reported; no law asks for it."""

import numpy as np

from gonio.checks.certificate import NOT_APPLICABLE, Property, verdict_of
from gonio.checks.direction_search import Rotated, pair, pair_angles, values
from gonio.checks.model.reciprocity import where_of, worst_difference
from gonio.checks.table.pairs import Pairs, angles_of, gathered
from gonio.checks.table.reciprocity import FEWEST, THETA_MAX, judged, not_applicable
from gonio.checks.table.significance import LEVEL
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF

GRAZING = np.radians(89.9)

TURN = np.pi / 2
"""A brushed surface is the same after half a turn: a quarter shows most."""


def model_isotropy(brdf: AbstractBRDF, tolerance: float) -> Property:
    """The largest relative change of f when both directions are turned; not applicable to what claims no isotropy."""
    angles = pair_angles(brdf)
    # Closer to the horizon the rounding of a turned direction is as large as its cosine.
    angles = angles[np.maximum(angles[:, 0], angles[:, 2]) <= GRAZING]
    worst = worst_difference(brdf, Rotated(0.7), angles, refine=False)
    residual, bound = worst["residual"], max(worst["bound"], worst["rounding"])
    several = values(brdf, *pair(angles[:1])).shape[-1] > 1
    found = Property(
        "isotropy",
        verdict_of(residual, bound, tolerance),
        residual,
        bound,
        tolerance,
        where_of(worst["angles"], worst["channel"] if several else None),
        f"The largest relative change of f as both directions are turned by 40° about the normal is {residual:.2g},"
        f" among {len(angles):,} pairs up to 89.9°.",
        {"pairs": len(angles), "pairs_without_a_value": worst["undefined"]},
    )
    if not brdf.isotropic:
        found.verdict = NOT_APPLICABLE
        found.detail += " The model does not claim to be isotropic."
    return found


def table_isotropy(table: Table, tolerance: float, level: float = LEVEL) -> Property:
    """Readings beside those with both directions turned by about a quarter, where a grid has both."""
    layout = table.layout
    axes = layout.axes
    turned = layout.turning_axes
    if not turned or any(a not in axes or axes[a].size < 4 for a in turned):
        return not_applicable("isotropy", tolerance, "Not testable: the light has one azimuth only.")
    cells = np.arange(layout.size)
    partner = layout.turned(cells, TURN)
    # Of four turns two pairs are made, so that no reading is in two.
    angle = np.unravel_index(cells, layout.shape)[list(axes).index(turned[0])]
    even = np.floor((axes[turned[0]][angle] - axes[turned[0]][0]) / TURN + 1e-9) % 2 == 0
    return _judged_cells("isotropy", table, cells, partner, even, tolerance, level, "f, and f turned about the normal")


def table_pole(table: Table, tolerance: float, level: float = LEVEL) -> Property:
    """At the normal a direction has no azimuth: readings there must not depend on it, where a grid has the normal."""
    layout, axes = table.layout, table.layout.axes
    cells, partners = [], []
    for polar, azimuth in layout.pole_axes:
        n = axes[azimuth].size
        if axes[polar][0] > 1e-9 or n < 2:
            continue
        at = np.unravel_index(np.arange(layout.size), layout.shape)
        names = list(axes)
        k, first = names.index(azimuth), at[names.index(polar)] == 0
        # Each azimuth with the one half of them further on; the normal of both directions is one reading many times.
        use = first & (at[k] < n // 2)
        moved = [a[use] + (n // 2 if j == k else 0) for j, a in enumerate(at)]
        cells.append(np.flatnonzero(use))
        partners.append(np.ravel_multi_index(moved, layout.shape))
    if not cells:
        return not_applicable("pole", tolerance, "Not testable: no readings at several azimuths of the normal.")
    cells, partners = np.concatenate(cells), np.concatenate(partners)
    cells, once = np.unique(cells, return_index=True)
    what = "f at the normal, by one azimuth and by another"
    return _judged_cells("pole", table, cells, partners[once], np.ones(cells.size, bool), tolerance, level, what)


def _judged_cells(name, table, cells, partner, use, tolerance, level, what) -> Property:
    wi_z, wo_z = (w.z for w in table.layout.directions_at(cells))
    use = use & (partner >= 0) & (partner != cells) & (np.minimum(wi_z, wo_z) > np.cos(THETA_MAX))
    cells, partner = cells[use], partner[use]
    if cells.size < FEWEST:
        return not_applicable(name, tolerance, "Not testable: too few readings of the grid can be compared.")
    (a, u_a), (b, u_b) = gathered(table, cells), gathered(table, partner)
    pairs = Pairs(a, b, u_a, u_b, angles_of(table.layout, cells), cells.size)
    # A violation has no sign here that a mean would keep.
    return judged(name, pairs, np.zeros(cells.size), 0.0, "measured pairs", tolerance, level, what)
