"""Pairs of readings that the format's own warp answers."""

from typing import Any

import equinox as eqx
import numpy as np

from gonio.checks.certificate import relative_difference
from gonio.checks.direction_search import directions, everywhere, values
from gonio.checks.table.pairs.pairs import Pairs
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.low_discrepancy import low_discrepancy

WARPED = 16384
"""Random pairs where a warp answers anywhere."""

WIDEST = np.radians(70.0)
"""Polar angle to which a format's warp is read: beyond, it answers where little or nothing was measured."""


def random_angles(theta_max: float, n: int = WARPED) -> np.ndarray:
    """Pairs of directions even in solid angle up to a polar angle: (n, 4)."""
    u = low_discrepancy(n, 4)
    return everywhere(u, np.arccos(1 - u[:, ::2] * (1 - np.cos(theta_max))))


def both_ways(brdf: AbstractBRDF, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f of n pairs of directions and of the exchanged pairs, each (n, channels)."""
    wi, wo = (directions(angles[:, k], angles[:, k + 1]) for k in (0, 2))
    return values(brdf, wi, wo), values(brdf, wo, wi)


def warp_of(table: Table) -> tuple[Any, Any | None]:
    """A format's own warp, and the same with every second stored incidence, where it has more than four."""
    assert table.interpolant is not None
    warp: Any = table.interpolant()
    if not hasattr(warp, "vndf") or warp.theta_i.shape[0] <= 4:
        return warp, None
    n = warp.theta_i.shape[0]
    keep = np.unique(np.append(np.arange(0, n, 2), n - 1))
    names = ("vndf", "conditional", "marginal", "spectra")

    def fields(m: Any) -> tuple[Any, ...]:
        return m.theta_i, *(getattr(m, k) for k in names)

    return warp, eqx.tree_at(fields, warp, (warp.theta_i[keep], *(getattr(warp, k)[:, keep] for k in names)))


def warped_pairs(table: Table) -> Pairs:
    """Random pairs answered by the format's own warp; the error is what every second incidence changes."""
    warp, coarse = warp_of(table)
    angles = random_angles(min(float(np.max(np.asarray(warp.theta_i))), WIDEST))
    a, b = both_ways(warp, angles)
    error: np.ndarray | None = None
    if coarse is not None:
        rough_a, rough_b = both_ways(coarse, angles)
        error = relative_difference(a, rough_a) + relative_difference(b, rough_b)
    unknown = np.full_like(a, np.nan)
    how = "random pairs, read by the format's own warp"
    return Pairs.of_arrays((a, b, unknown, unknown), angles, len(a), how, error)
