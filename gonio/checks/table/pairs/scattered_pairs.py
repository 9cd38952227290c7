"""Pairs of readings where no grid has them: near partners, the format's own warp, or interpolation with its error."""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from gonio.checks.certificate import relative_difference
from gonio.checks.direction_search import directions, everywhere, values
from gonio.checks.table.pairs.columns import readings_of
from gonio.checks.table.pairs.pairs import Pairs
from gonio.checks.table.pairs.places import angles_of
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.display import percent
from gonio.models.geometry.low_discrepancy import low_discrepancy

NEAR = np.radians(2.0)
"""A reading this close to the wanted pair of directions may stand for it; the error is estimated."""

EXACT = 1e-6
"""Distance, about radians, of two pairs of directions that are one."""

SAME_LIGHT = np.radians(0.05)
"""Polar angles nearer than that are one."""

ROUNDING = 1e-6
"""Relative scatter of repeats that are copies of one another."""

NEIGHBOURS = 8
FEWEST_NEAR = 4
"""Readings about a direction of which none is exact, from which its value and the error of that are taken."""

BETWEEN = 3.0
"""Error of a value between near readings, in their spread: a lobe may be narrower than their distances."""

STEEPEST = 0.2
"""Relative error of a value between near readings above which it stands for nothing."""

FEWEST_REPEATS = 12
"""Repeated readings, less their means, from which the noise is taken where none is stored."""

LEAF = 16
"""Points of a leaf of the trees; it decides between neighbours that are equally near."""

WARPED = 16384
"""Random pairs where a warp answers anywhere."""

WIDEST = np.radians(70.0)
"""Polar angle to which a format's warp is read: beyond, it answers where little or nothing was measured."""


def isotropic_light(table: Table) -> bool:
    """Whether all readings of a scattered table have the light at one azimuth."""
    theta, phi = table.layout.axes["theta_i"], table.layout.axes["phi_i"]
    x, y = np.cos(phi)[theta > 1e-9], np.sin(phi)[theta > 1e-9]
    return x.size == 0 or bool(np.ptp(x) < 1e-9 and np.ptp(y) < 1e-9)


def one_sided(angles: np.ndarray) -> bool:
    """Whether all azimuth differences of (n, 4) angles are on one side of the plane of incidence, or in it."""
    turn = np.mod(angles[:, 3] - angles[:, 1] + np.pi, 2 * np.pi) - np.pi
    lateral = np.sin(angles[:, 0]) * np.sin(angles[:, 2]) * np.sin(turn)
    return bool((lateral > -1e-6).all() or (lateral < 1e-6).all())


def pair_points(angles: np.ndarray, isotropic: bool, mirrored: bool) -> np.ndarray:
    """Points whose distances are about the angles, radians, between pairs of directions, (n, 4) or (n, 6)."""
    theta_i, phi_i, theta_o, phi_o = angles.T
    if isotropic:
        turn = phi_o - phi_i
        across = np.sqrt(np.sin(theta_i) * np.sin(theta_o))
        lateral = np.abs(np.sin(turn)) if mirrored else np.sin(turn)
        return np.stack([theta_i, theta_o, across * np.cos(turn), across * lateral], -1)
    return np.stack([*directions(theta_i, phi_i), *directions(theta_o, phi_o)], -1)


class Readings(NamedTuple):
    """Readings at different pairs of directions, repeats merged: angles (n, 4), f and u (n, channels)."""

    angles: np.ndarray
    f: np.ndarray
    u: np.ndarray
    repeated: int
    """Readings that were merged into others."""
    scatter: float
    """Relative standard deviation of repeats; NaN where there are too few."""


def merged(angles: np.ndarray, f: np.ndarray, u: np.ndarray, points: np.ndarray) -> Readings:
    """The means of readings whose points, (n, k), agree to `EXACT`; their scatter is the noise where none is stored."""
    _, first, group, count = np.unique(
        np.round(points / EXACT), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    group = group.ravel()
    if count.max(initial=1) == 1:
        return Readings(angles, f, u, 0, np.nan)

    def total(v: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(group, c, count.size) for c in v.T], -1)

    n = count[:, None]
    mean, uncertainty = total(f) / n, np.sqrt(total(u**2)) / n
    freedom = int(np.sum(count - 1))
    size = np.maximum(np.abs(mean[group]), 1e-300)
    scatter = float(np.sqrt(np.sum(((f - mean[group]) / size) ** 2) / (freedom * f.shape[1])))
    if freedom >= FEWEST_REPEATS and scatter > ROUNDING and not np.isfinite(uncertainty).any():
        uncertainty = scatter * np.abs(mean) / np.sqrt(n)
    return Readings(angles[first], mean, uncertainty, freedom, scatter if freedom >= FEWEST_REPEATS else np.nan)


def scattered_pairs(table: Table) -> Pairs:
    """Readings with those of the exchanged directions: exact ones, or interpolated between near ones, with the error.

    Readings of one direction are merged first. What stands for the exchanged direction is nearer to it than half of
    its distance from the reading's own: nothing is compared with itself or with its neighbours.
    """
    from scipy.spatial import KDTree

    isotropic, cells = isotropic_light(table), np.arange(table.layout.size)
    angles = angles_of(table.layout, cells)
    f, u = readings_of(table, cells)
    use = table.layout.readable() & np.isfinite(f).all(axis=1)
    mirrored = isotropic and one_sided(angles[use])
    readings = merged(angles[use], f[use], u[use], pair_points(angles[use], isotropic, False))
    angles, f, u, repeated, scatter = readings
    how = "readings whose exchanged directions were read" + (", taking the surface as isotropic" if isotropic else "")
    how += " and mirror symmetric, as azimuth differences are on one side" if mirrored else ""
    if repeated:
        how += f", {repeated:,} repeats merged"
        how += f" (they scatter by {percent(scatter)})" if np.isfinite(scatter) else ""
    if len(f) < 2:
        return Pairs.of_arrays((f[:0], f[:0], u[:0], u[:0]), angles[:0], len(f), how, merged=angles)
    here = pair_points(angles, isotropic, mirrored)
    there = pair_points(angles[:, [2, 3, 0, 1]], isotropic, mirrored)
    distance, near = (np.asarray(a) for a in KDTree(here, LEAF).query(there, min(NEIGHBOURS, len(f))))
    number = np.arange(len(near))
    # On an isotropic surface a reading of θo = θi is exchanged by mirroring it: it says nothing of reciprocity.
    apart = np.sqrt(2) * np.abs(angles[:, 0] - angles[:, 2]) if isotropic else np.linalg.norm(here - there, axis=1)
    apart = np.where(apart > SAME_LIGHT, apart, 0.0)[:, None]
    exact = distance[:, :1] <= EXACT
    usable = np.where(exact, distance <= EXACT, distance <= NEAR) & (distance < apart / 2)
    # Near ones have to lie on all sides: beyond the last of them, and of the last incidence, nothing is known.
    offset = np.where(usable[..., None], here[near] - there[:, None], 0.0)
    around = (offset.min(axis=1) <= EXACT) & (offset.max(axis=1) >= -EXACT) & (np.ptp(offset, axis=1) > 0)
    usable &= exact | around.all(axis=1)[:, None]
    # Two that are each other's exact partners are one pair.
    twice = exact[:, 0] & (near[near[:, 0], 0] == number) & (near[:, 0] < number)
    keep = (usable.sum(axis=1) >= np.where(exact[:, 0], 1, FEWEST_NEAR)) & ~twice
    weight = np.where(usable, 1 / np.maximum(distance, EXACT) ** 2, 0.0)[keep]
    weight = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    a, partners = f[keep], f[near[keep]]
    b, u_b = np.sum(weight * partners, axis=1), np.sqrt(np.sum((weight * u[near[keep]]) ** 2, axis=1))
    between = np.where(usable[keep][..., None], partners, np.nan)
    spread = np.nanmax(between, axis=1) - np.nanmin(between, axis=1) if len(a) else a
    error = np.where(exact[keep], 0.0, 2 * BETWEEN * spread / np.maximum(np.abs(a) + np.abs(b), 1e-300))
    # Where f is steep the spread of a few readings bounds nothing.
    a = np.where(error <= STEEPEST, a, np.nan)
    return Pairs.of_arrays((a, b, u[keep], u_b), angles[keep], len(f), how, error, merged=angles)


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
