"""Reciprocity and symmetries of a table: readings that should be equal, pair by pair.

Where uncertainties are stored a family of tests decides at a stated level (`significance`). Else the residual
is the median of 2|a − b|/(|a| + |b|) over the pairs with both polar angles below 70°, of all channels together (dark
channels, which are mostly noise, are named but do not decide), and the bound is the error of interpolating a partner
that was not measured.
"""

from typing import Any

import numpy as np

from gonio.checks.certificate import (
    NOT_APPLICABLE,
    UNDECIDED,
    Property,
    place_of,
    relative_difference,
    verdict_of,
    without_residual,
)
from gonio.checks.table.evidence import TableEvidence
from gonio.checks.table.pairs import FEWEST, Pairs
from gonio.checks.table.significance import decided_by_uncertainty, judged_by_level

SCATTER = (0.8, 1.25)
"""Scatter of the pairs, in their stated uncertainties, outside of which these are doubted."""

ROUNDING = 4 * float(np.finfo(np.float32).eps)
"""Tables may be stored in single precision."""


def table_reciprocity(evidence: TableEvidence, tolerance: float) -> Property:
    """f(wi, wo) = f(wo, wi); not applicable where the layout stores one value for both."""
    pairs = evidence.pairs("exchanged")
    sign = None if isinstance(pairs, str) else pairs.angles[:, 0] - pairs.angles[:, 2]
    return _equal("reciprocity", evidence, pairs, sign, tolerance, "f(wi, wo) and f(wo, wi)")


def table_symmetry(evidence: TableEvidence, tolerance: float) -> Property:
    """f(Δφ) = f(−Δφ), where the grid has both."""
    pairs = evidence.pairs("mirrored")
    sign = None if isinstance(pairs, str) else np.sin(pairs.angles[:, 3] - pairs.angles[:, 1])
    return _equal("symmetry", evidence, pairs, sign, tolerance, "f(Δφ) and f(−Δφ)")


def table_isotropy(evidence: TableEvidence, tolerance: float) -> Property:
    """Readings beside those with both directions turned by about a quarter, where a grid has both."""
    return _equal("isotropy", evidence, evidence.pairs("turned"), None, tolerance, "f, and f turned about the normal")


def table_pole(evidence: TableEvidence, tolerance: float) -> Property:
    """At the normal a direction has no azimuth: readings there must not depend on it, where a grid has the normal."""
    what = "f at the normal, by one azimuth and by another"
    return _equal("pole", evidence, evidence.pairs("pole"), None, tolerance, what)


def _equal(
    name: str, evidence: TableEvidence, pairs: Pairs | str, sign: np.ndarray | None, tolerance: float, what: str
) -> Property:
    """The property that readings a and b are the same: by their uncertainties at the level, else by their median.

    `sign` (n,) is that of a violation in each pair; None where a violation has no sign that a mean would keep.
    """
    if isinstance(pairs, str):
        return without_residual(name, NOT_APPLICABLE, tolerance, f"Not testable: {pairs}.")
    comparable = np.isfinite(pairs.a) & np.isfinite(pairs.b)
    number = int(comparable.any(axis=1).sum())
    facts = {"pairs": number, "cells_asked": pairs.eligible, "method": pairs.how}
    if comparable.sum(axis=0).max(initial=0) < FEWEST:
        detail = (
            f"Only {number} pairs of readings below 70° can be compared ({pairs.how}); at least {FEWEST} are needed."
        )
        return without_residual(name, UNDECIDED, tolerance, detail, **facts)
    difference = np.where(comparable, relative_difference(np.nan_to_num(pairs.a), np.nan_to_num(pairs.b)), np.nan)
    medians = [float(np.nanmedian(d)) if np.isfinite(d).any() else np.nan for d in difference.T]
    residual, bound = float(np.nanmedian(difference)), pairs.error + ROUNDING
    k, channel = np.unravel_index(np.nanargmax(difference), difference.shape)
    facts |= {
        "median_by_channel": medians,
        "largest": float(difference[k, channel]),
        "percentile_95": float(np.nanpercentile(difference, 95)),
        "interpolation_error": pairs.error,
        **_scatter(pairs, comparable),
    }
    if decided_by_uncertainty(pairs):
        facts["median"] = residual
        signs = np.zeros(len(pairs.a)) if sign is None else np.sign(np.round(sign, 9))
        judged = judged_by_level(name, evidence, pairs, signs, tolerance, what)
        judged.facts, judged.detail = facts | judged.facts, judged.detail + _remark_on_scatter(facts)
    else:
        detail = (
            f"The median of 2|a−b|/(|a|+|b|) of {what} over {number:,} {pairs.how}, below 70°, is {residual:.2%}"
            f" (±{bound:.2%}); the largest is {facts['largest']:.2g}."
        )
        worst = int(np.nanargmax(medians))
        if residual <= tolerance < medians[worst] - bound:
            detail += f" Channel {evidence.channel(worst)} alone has {medians[worst]:.2%}."
        where = place_of(pairs.angles[k], evidence.channel(int(channel)))
        verdict = verdict_of(residual, bound, tolerance)
        judged = Property(name, verdict, residual, bound, tolerance, where, detail, facts)
    judged.series |= _by_band(pairs, difference)
    return judged


def _by_band(pairs: Pairs, difference: np.ndarray) -> dict[str, list[float]]:
    """Median difference over bands of 5° of the larger polar angle."""
    theta = np.degrees(np.maximum(pairs.angles[:, 0], pairs.angles[:, 2]))
    bands = {low + 2.5: difference[(theta >= low) & (theta < low + 5)] for low in range(0, 70, 5)}
    bands = {middle: float(np.nanmedian(band)) for middle, band in bands.items() if np.isfinite(band).any()}
    return {"theta_deg": list(bands), "median": list(bands.values())}


def _scatter(pairs: Pairs, comparable: np.ndarray) -> dict[str, Any]:
    variance = pairs.u_a**2 + pairs.u_b**2
    known = comparable & (variance > 0)
    if not known.any():
        return {}
    z2 = (pairs.a[known] - pairs.b[known]) ** 2 / variance[known]
    return {
        "chi2_per_pair": float(np.mean(z2)),
        "share_beyond_2_sigma": float(np.mean(z2 > 4)),
        "share_beyond_3_sigma": float(np.mean(z2 > 9)),
        "pairs_with_uncertainty": int(known.sum()),
        # Half of the squares of a normal deviate are below 0.4549: few wrong pairs do not change it.
        "scatter_in_uncertainties": float(np.sqrt(np.median(z2) / 0.4549)),
    }


def _remark_on_scatter(facts: dict[str, Any]) -> str:
    scatter = facts["scatter_in_uncertainties"]
    if SCATTER[0] <= scatter <= SCATTER[1]:
        return ""
    stated = "small" if scatter > 1 else "large"
    return (
        f" The pairs scatter {scatter:.2g} times as much as their uncertainties say: these may be stated too {stated},"
        " and p-values are only as good as they are."
    )
