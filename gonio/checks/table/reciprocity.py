"""Reciprocity and bilateral symmetry of a table: the readings that should be equal, pair by pair where there are pairs.

Where uncertainties are stored a family of tests decides at a stated level (`significance`). Else the residual
is the median of 2|a − b|/(|a| + |b|) over the pairs with both polar angles below 70°, of all channels together (dark
channels, which are mostly noise, are named but do not decide), and the bound is the error of interpolating a partner
that was not measured.
"""

import numpy as np

from gonio.checks.certificate import NOT_APPLICABLE, UNDECIDED, Property, verdict_of
from gonio.checks.model.reciprocity import relative_difference, where_of
from gonio.checks.table.pairs import Pairs, paired
from gonio.checks.table.scattered_pairs import interpolated_pairs, scattered_pairs, warped_pairs
from gonio.checks.table.significance import LEVEL, decided_by_uncertainty, judged_by_level, tested
from gonio.data.table import Table

THETA_MAX = np.radians(70.0)
FEWEST = 12
"""Pairs below which a median says nothing."""

SCATTER = (0.8, 1.25)
"""Scatter of the pairs, in their stated uncertainties, outside of which these are doubted."""

ROUNDING = 4 * float(np.finfo(np.float32).eps)
"""Tables may be stored in single precision."""


def reciprocal_pairs(table: Table) -> tuple[Pairs, float, str] | None:
    """(pairs that should be equal, relative error of the partners, how they were found), below `THETA_MAX`.

    None where the layout stores one value for both.
    """
    layout = table.layout
    if table.interpolant is not None:
        return warped_pairs(table, THETA_MAX)
    if not layout.gridded:
        return scattered_pairs(table, THETA_MAX, swap=True)
    if layout.reciprocal_by_construction:
        return None
    pairs, how = paired(table, layout.exchanged, THETA_MAX), "measured pairs"
    if layout.mirrored_axes:
        how += ", taking the surface as mirror symmetric, as azimuth differences stop at 180°"
    if layout.one_light_azimuth:
        how += ", taking the surface as isotropic, as the light has one azimuth"
    if len(pairs.a) < max(FEWEST, 0.01 * pairs.eligible) and not layout.in_one_plane:
        return interpolated_pairs(table, THETA_MAX)
    return pairs, 0.0, how


def table_reciprocity(table: Table, tolerance: float, level: float = LEVEL) -> Property:
    """Reciprocity of a table; not applicable where its layout stores one value for both directions.

    `level`: chance of calling an honest table significantly wrong, where uncertainties are stored.
    """
    found = reciprocal_pairs(table)
    if found is None:
        return not_applicable(
            "reciprocity", tolerance, "Not testable: the layout stores one value for phi_d and phi_d + 180°."
        )
    pairs, error, how = found
    sign = np.sign(np.round(pairs.angles[:, 0] - pairs.angles[:, 2], 9))
    return judged("reciprocity", pairs, sign, error, how, tolerance, level, "f(wi, wo) and f(wo, wi)")


def table_symmetry(table: Table, tolerance: float, level: float = LEVEL) -> Property:
    """f(Δφ) = f(−Δφ) of a table, where its grid has both."""
    if table.layout.mirror_map() is None:
        return not_applicable("symmetry", tolerance, "Not testable: no readings on both sides of a plane.")
    pairs = paired(table, table.layout.mirrored, THETA_MAX)
    if len(pairs.a) < FEWEST:
        return not_applicable("symmetry", tolerance, "Not testable: the grid has no mirrored nodes.")
    sign = np.sign(np.round(np.sin(pairs.angles[:, 3] - pairs.angles[:, 1]), 9))
    return judged("symmetry", pairs, sign, 0.0, "measured pairs", tolerance, level, "f(Δφ) and f(−Δφ)")


def not_applicable(name: str, tolerance: float, detail: str) -> Property:
    """The property that a table's layout cannot show."""
    return Property(name, NOT_APPLICABLE, None, None, tolerance, detail=detail)


def judged(
    name: str, pairs: Pairs, sign: np.ndarray, error: float, how: str, tolerance: float, level: float, what: str
) -> Property:
    """The property that readings a and b are the same: by their uncertainties at `level`, else by their median.

    `sign` (n,) says which way a violation goes in each pair (0: unknown), `error` what is known of the partners' own.
    """
    found = np.isfinite(pairs.a) & np.isfinite(pairs.b)
    counts = found.sum(axis=0)
    facts = {"pairs": int(found.any(axis=1).sum()), "cells_asked": pairs.eligible, "method": how}
    if counts.size == 0 or counts.max() < FEWEST:
        detail = (
            f"Only {facts['pairs']} pairs of readings below 70° can be compared ({how}); at least {FEWEST} are needed."
        )
        return Property(name, UNDECIDED, None, None, tolerance, detail=detail, facts=facts)
    difference = np.where(found, relative_difference(np.nan_to_num(pairs.a), np.nan_to_num(pairs.b)), np.nan)
    medians = [float(np.median(d[ok])) if ok.any() else np.nan for d, ok in zip(difference.T, found.T, strict=True)]
    residual = float(np.median(difference[found]))
    bound = error + ROUNDING
    k, channel = np.unravel_index(np.nanargmax(difference), difference.shape)
    where = where_of(pairs.angles[k], int(channel) if found.shape[1] > 1 else None)
    facts |= {
        "median_by_channel": medians,
        "largest": float(difference[k, channel]),
        "percentile_95": float(np.nanpercentile(difference, 95)),
        "interpolation_error": error,
        **_statistic(pairs, found),
    }
    detail = (
        f"The median of 2|a−b|/(|a|+|b|) of {what} over {facts['pairs']:,} {how}, below 70°, is {residual:.2%}"
        f" (±{bound:.2%}); the largest is {facts['largest']:.2g}."
    )
    odd = [c for c, m in enumerate(medians) if m - bound > tolerance]
    if odd and residual <= tolerance:
        c = max(odd, key=lambda c: medians[c])
        detail += f" Channel {c} alone has {medians[c]:.2%}."
    series = {"theta_deg": [], "median": []}
    theta = np.degrees(np.maximum(pairs.angles[:, 0], pairs.angles[:, 2]))
    for low in range(0, 70, 5):
        band = difference[(theta >= low) & (theta < low + 5)]
        if np.isfinite(band).any():
            series["theta_deg"].append(low + 2.5)
            series["median"].append(float(np.nanmedian(band)))
    if decided_by_uncertainty(pairs):
        found = tested(pairs, sign, level, error)
        facts["median"] = residual
        p = judged_by_level(name, found, how, facts["pairs"], tolerance, level, what, facts)
        p.series |= series
        p.detail += _remark_on_scatter(facts["scatter_in_uncertainties"])
        return p
    return Property(
        name, verdict_of(residual, bound, tolerance), residual, bound, tolerance, where, detail, facts, series
    )


def _statistic(pairs, found):
    variance = pairs.u_a**2 + pairs.u_b**2
    use = found & (variance > 0)
    if not use.any():
        return {}
    z2 = (pairs.a[use] - pairs.b[use]) ** 2 / variance[use]
    return {
        "chi2_per_pair": float(np.mean(z2)),
        "share_beyond_2_sigma": float(np.mean(z2 > 4)),
        "share_beyond_3_sigma": float(np.mean(z2 > 9)),
        "pairs_with_uncertainty": int(use.sum()),
        # Half of the squares of a normal deviate are below 0.4549: few wrong pairs do not change it.
        "scatter_in_uncertainties": float(np.sqrt(np.median(z2) / 0.4549)),
    }


def _remark_on_scatter(scatter: float) -> str:
    if SCATTER[0] <= scatter <= SCATTER[1]:
        return ""
    stated = "small" if scatter > 1 else "large"
    return (
        f" The pairs scatter {scatter:.2g} times as much as their uncertainties say: these may be stated too {stated},"
        " and p-values are only as good as they are."
    )
