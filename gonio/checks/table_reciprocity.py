"""Reciprocity and bilateral symmetry of a table: the readings that should be equal, pair by pair where there are pairs.

The residual is the median of 2|a − b|/(|a| + |b|) over the pairs with both polar angles below 70°, of all channels
together (dark channels, which are mostly noise, are named but do not decide). The bound is what may be wrong with it:
the noise that the stored uncertainties make (the median of a normal deviate of their size), and where a partner was
not measured the error of interpolating it.
"""

import numpy as np

from gonio.certificate import NOT_APPLICABLE, UNDECIDED, Property, verdict_of
from gonio.checks.partners import Pairs, folded, mirrored_nodes, one_light_azimuth, paired, reciprocal_nodes
from gonio.checks.reciprocity import relative_difference, where_of
from gonio.checks.scattered import interpolated_pairs, scattered_pairs, warped_pairs
from gonio.data.table import Table

THETA_MAX = np.radians(70.0)
FEWEST = 12
"""Pairs below which a median says nothing."""

ROUNDING = 4 * float(np.finfo(np.float32).eps)
"""Tables may be stored in single precision."""

MEDIAN_OF_NORMAL = 0.6745
"""Median of |x| for a standard normal x."""


def table_reciprocity(table: Table, tolerance: float) -> Property:
    """Reciprocity of a table; not applicable where its layout stores one value for both directions."""
    layout = table.layout
    if table.interpolant is not None:
        pairs, error, how = warped_pairs(table, THETA_MAX)
    elif not layout.gridded:
        pairs, error, how = scattered_pairs(table, THETA_MAX, swap=True)
    else:
        nodes = [] if layout.name == "in_plane" else reciprocal_nodes(layout)
        if nodes is None:
            return _not_applicable(
                "reciprocity", tolerance, "Not testable: the layout stores one value for phi_d and phi_d + 180°."
            )
        pairs, error, how = paired(table, nodes, THETA_MAX), 0.0, "measured pairs"
        if folded(layout):
            how += ", taking the surface as mirror symmetric, as azimuth differences stop at 180°"
        if one_light_azimuth(layout):
            how += ", taking the surface as isotropic, as the light has one azimuth"
        if len(pairs.a) < max(FEWEST, 0.02 * pairs.eligible) and layout.name != "in_plane":
            pairs, error, how = interpolated_pairs(table, THETA_MAX)
    return _judged("reciprocity", pairs, error, how, tolerance, "f(wi, wo) and f(wo, wi)")


def table_symmetry(table: Table, tolerance: float) -> Property:
    """f(Δφ) = f(−Δφ) of a table, where its grid has both."""
    nodes = mirrored_nodes(table.layout) if table.layout.gridded else None
    if nodes is None:
        return _not_applicable("symmetry", tolerance, "Not testable: no readings on both sides of a plane.")
    pairs = paired(table, nodes, THETA_MAX)
    if len(pairs.a) < FEWEST:
        return _not_applicable("symmetry", tolerance, "Not testable: the grid has no mirrored nodes.")
    return _judged("symmetry", pairs, 0.0, "measured pairs", tolerance, "f(Δφ) and f(−Δφ)")


def _not_applicable(name, tolerance, detail):
    return Property(name, NOT_APPLICABLE, None, None, tolerance, detail=detail)


def _judged(name: str, pairs: Pairs, error: float, how: str, tolerance: float, what: str) -> Property:
    found = np.isfinite(pairs.a) & np.isfinite(pairs.b)
    counts = found.sum(axis=0)
    facts = {"pairs": int(found.any(axis=1).sum()), "cells_asked": pairs.eligible, "method": how}
    if counts.size == 0 or counts.max() < FEWEST:
        detail = (
            f"Only {facts['pairs']} pairs of readings below 70° can be compared ({how}); at least {FEWEST} are needed."
        )
        return Property(name, UNDECIDED, None, None, tolerance, detail=detail, facts=facts)
    difference = np.where(found, relative_difference(np.nan_to_num(pairs.a), np.nan_to_num(pairs.b)), np.nan)
    with np.errstate(all="ignore"):
        noise = MEDIAN_OF_NORMAL * 2 * np.hypot(pairs.u_a, pairs.u_b) / (np.abs(pairs.a) + np.abs(pairs.b))
    medians = [float(np.median(d[ok])) if ok.any() else np.nan for d, ok in zip(difference.T, found.T, strict=True)]
    residual = float(np.median(difference[found]))
    known = noise[found & np.isfinite(noise)]
    bound = error + (float(np.median(known)) if known.size else 0.0) + ROUNDING
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
    if "share_beyond_2_sigma" in facts:
        detail += (
            f" By the stored uncertainties {facts['share_beyond_2_sigma']:.1%} of the pairs differ by more than two"
            " standard deviations (4.6% if noise were all)."
        )
    series = {"theta_deg": [], "median": []}
    theta = np.degrees(np.maximum(pairs.angles[:, 0], pairs.angles[:, 2]))
    for low in range(0, 70, 5):
        band = difference[(theta >= low) & (theta < low + 5)]
        if np.isfinite(band).any():
            series["theta_deg"].append(low + 2.5)
            series["median"].append(float(np.nanmedian(band)))
    return Property(
        name, verdict_of(residual, bound, tolerance), residual, bound, tolerance, where, detail, facts, series
    )


def _statistic(pairs, found):
    variance = pairs.u_a**2 + pairs.u_b**2
    use = found & (variance > 0)
    if not use.any():
        return {}
    z2 = (pairs.a[use] - pairs.b[use]) ** 2 / variance[use]
    # Each pair appears twice, once from either side, which changes neither mean nor share.
    return {
        "chi2_per_pair": float(np.mean(z2)),
        "share_beyond_2_sigma": float(np.mean(z2 > 4)),
        "share_beyond_3_sigma": float(np.mean(z2 > 9)),
        "pairs_with_uncertainty": int(use.sum()),
    }
