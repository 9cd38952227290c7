"""Pairs of readings where no grid has them: near partners, the format's own warp, or interpolation with its error."""

from typing import Any

import equinox as eqx
import numpy as np

from gonio.checks.certificate import relative_difference
from gonio.checks.direction_search import directions, everywhere, values
from gonio.checks.table.pairs import THETA_MAX, Pairs, angles_of, pair_angles, readings_of
from gonio.data.flags import Flag
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.low_discrepancy import low_discrepancy

NEAR = np.radians(2.0)
"""A reading this close to the wanted pair of directions may stand for it; the error is estimated."""

EXACT = 1e-6
NEIGHBOURS = 4
LEAF = 16
"""Points of a leaf of the trees; it decides between neighbours that are equally near."""

WARPED = 16384
"""Random pairs where a warp answers anywhere."""

INTERPOLATED = 20_000


def isotropic_light(table: Table) -> bool:
    """Whether all readings of a scattered table have the light at one azimuth."""
    theta, phi = table.layout.axes["theta_i"], table.layout.axes["phi_i"]
    x, y = np.cos(phi)[theta > 1e-9], np.sin(phi)[theta > 1e-9]
    return x.size == 0 or bool(np.ptp(x) < 1e-9 and np.ptp(y) < 1e-9)


def _features(angles: np.ndarray, isotropic: bool) -> np.ndarray:
    """Points whose distances are about the angles, radians, between pairs of directions, (n, 3) or (n, 6)."""
    theta_i, phi_i, theta_o, phi_o = angles.T
    if isotropic:
        turn = np.abs(np.mod(phi_o - phi_i + np.pi, 2 * np.pi) - np.pi)
        return np.stack([theta_i, theta_o, np.sqrt(np.sin(theta_i) * np.sin(theta_o)) * turn], -1)
    return np.stack([*directions(theta_i, phi_i), *directions(theta_o, phi_o)], -1)


def scattered_pairs(table: Table) -> Pairs:
    """Readings with the mean of the readings nearest their reciprocal pair, and the error that nearness leaves."""
    from scipy.spatial import KDTree

    isotropic = isotropic_light(table)
    cells = np.arange(table.layout.size)
    angles = angles_of(table.layout, cells)
    f, u = readings_of(table, cells)
    use = (np.maximum(angles[:, 0], angles[:, 2]) < THETA_MAX) & np.isfinite(f).all(axis=1)
    angles, f, u = angles[use], f[use], u[use]
    how = "readings with a near partner" + (", taking the surface as isotropic" if isotropic else "")
    if len(f) <= NEIGHBOURS:
        return Pairs(f[:0], f[:0], u[:0], u[:0], angles[:0], len(f), how)
    tree = KDTree(_features(angles, isotropic), LEAF)
    distance, near = (np.asarray(a) for a in tree.query(_features(angles[:, [2, 3, 0, 1]], isotropic), NEIGHBOURS))
    number = np.arange(len(near))
    # A reading must not be compared with itself; two that are each other's exact partners are one pair.
    twice = (distance[:, 0] <= EXACT) & (near[near[:, 0], 0] == number) & (near[:, 0] < number)
    keep = (distance[:, 0] <= NEAR) & (near[:, 0] != number) & ~twice
    distance, near, a = distance[keep], near[keep], f[keep]
    exact = distance[:, :1] <= EXACT
    weight = np.where(exact, distance <= EXACT, 1 / np.maximum(distance, 1e-9) ** 2)
    weight = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    b = np.sum(weight * f[near], axis=1)
    u_b = np.sqrt(np.sum((weight * u[near]) ** 2, axis=1))
    spread = np.where(exact, 0.0, np.ptp(f[near], axis=1) / 2)
    size = np.maximum(np.abs(a) + np.abs(b), 1e-300)
    error = float(np.max(np.median(2 * spread / size, axis=0))) if len(a) else 0.0
    return Pairs(a, b, u[keep], u_b, angles[keep], len(f), how, error)


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
    """Random pairs answered by the format's own warp; the error is that of every second incidence, by thirds."""
    warp, coarse = warp_of(table)
    angles = random_angles(THETA_MAX)
    a, b = both_ways(warp, angles)
    error = 0.0
    if coarse is not None:
        rough, _ = both_ways(coarse, angles)
        error = float(np.max(np.median(relative_difference(a, rough), axis=0))) / 3
    unknown = np.full_like(a, np.nan)
    return Pairs(a, b, unknown, unknown, angles, len(a), "random pairs, read by the format's own warp", error)


def interpolated_pairs(table: Table) -> Pairs:
    """Readings with the interpolated value of their reciprocal pair, and that interpolation's error."""
    from gonio.data.interpolation.multilinear import as_material, interpolation_error

    some = table.samples(INTERPOLATED, THETA_MAX)
    partner = values(as_material(table), some.wo, some.wi)
    f = np.where(some.flag == Flag.VALID, some.f, np.nan).astype(float)
    angles = pair_angles(some.wi, some.wo)
    u = np.asarray(some.u_f, float)
    # The error of the finer grid is a third of the difference between the two only where both resolve the lobe.
    error = 3 * interpolation_error(table, INTERPOLATED, THETA_MAX).median
    return Pairs(f, partner, u, u, angles, len(f), "readings whose partners were interpolated", error)
