"""Pairs of readings where no grid has them: near partners, the format's own warp, or interpolation with its error."""

import equinox as eqx
import numpy as np

from gonio.checks.direction_search import directions, values
from gonio.checks.model.reciprocity import relative_difference
from gonio.checks.table.pairs import Pairs, angles_of, gathered
from gonio.data.table import Table
from gonio.models.geometry.low_discrepancy import low_discrepancy

NEAR = np.radians(2.0)
"""A reading this close to the wanted pair of directions may stand for it; the error is estimated."""

NEIGHBOURS = 4
DRAWN = 16384
"""Random pairs where a warp answers anywhere."""


def isotropic_light(table: Table) -> bool:
    """Whether all readings of a scattered table have the light at one azimuth."""
    theta, phi = table.layout.axes["theta_i"], table.layout.axes["phi_i"]
    x, y = np.cos(phi)[theta > 1e-9], np.sin(phi)[theta > 1e-9]
    return x.size == 0 or (np.ptp(x) < 1e-9 and np.ptp(y) < 1e-9)


def features(angles: np.ndarray, isotropic: bool) -> np.ndarray:
    """Points whose distances are about the angles, radians, between pairs of directions, (n, 3) or (n, 6)."""
    theta_i, phi_i, theta_o, phi_o = angles.T
    if isotropic:
        turn = np.abs(np.mod(phi_o - phi_i + np.pi, 2 * np.pi) - np.pi)
        return np.stack([theta_i, theta_o, np.sqrt(np.sin(theta_i) * np.sin(theta_o)) * turn], -1)
    wi, wo = directions(theta_i, phi_i), directions(theta_o, phi_o)
    return np.stack([*wi, *wo], -1)


def scattered_pairs(table: Table, theta_max: float, swap: bool) -> tuple[Pairs, float, str]:
    """Readings with the mean of the readings nearest their reciprocal pair, and the error that nearness leaves."""
    from scipy.spatial import cKDTree

    isotropic = isotropic_light(table)
    cells = np.arange(table.layout.size)
    angles = angles_of(table.layout, cells)
    f, u = gathered(table, cells)
    use = (np.maximum(angles[:, 0], angles[:, 2]) < theta_max) & np.isfinite(f).all(axis=1)
    angles, f, u = angles[use], f[use], u[use]
    how = "readings with a near partner" + (", taking the surface as isotropic" if isotropic else "")
    if len(f) <= NEIGHBOURS:
        return Pairs(f[:0], f[:0], u[:0], u[:0], angles[:0], len(f)), 0.0, how
    wanted = angles[:, [2, 3, 0, 1]] if swap else angles
    here = features(angles, isotropic)
    distance, near = cKDTree(here).query(features(wanted, isotropic), k=NEIGHBOURS)
    # A reading must not be held against itself.
    own = near[:, 0] == np.arange(len(near))
    # Two readings that are each other's exact partners are one pair.
    number = np.arange(len(near))
    twice = (distance[:, 0] <= 1e-6) & (near[near[:, 0], 0] == number) & (near[:, 0] < number)
    keep = (distance[:, 0] <= NEAR) & ~own & ~twice
    distance, near = distance[keep], near[keep]
    exact = distance[:, :1] <= 1e-6
    weight = np.where(exact, distance <= 1e-6, 1 / np.maximum(distance, 1e-9) ** 2)
    weight = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    partner = np.sum(weight * f[near], axis=1)
    u_partner = np.sqrt(np.sum((weight * u[near]) ** 2, axis=1))
    spread = np.where(exact, 0.0, np.ptp(f[near], axis=1) / 2)
    a = f[keep]
    size = np.maximum(np.abs(a) + np.abs(partner), 1e-300)
    error = float(np.max(np.median(2 * spread / size, axis=0))) if len(a) else 0.0
    return Pairs(a, partner, u[keep], u_partner, angles[keep], len(f)), error, how


def random_angles(theta_max: float, n: int = DRAWN) -> np.ndarray:
    """Pairs of directions even in solid angle up to a polar angle: (n, 4)."""
    u = low_discrepancy(n, 4)
    theta = np.arccos(1 - u[:, ::2] * (1 - np.cos(theta_max)))
    return np.stack([theta[:, 0], 2 * np.pi * u[:, 1], theta[:, 1], 2 * np.pi * u[:, 3]], -1)


def _both_ways(brdf, angles) -> tuple[np.ndarray, np.ndarray]:
    wi, wo = directions(angles[:, 0], angles[:, 1]), directions(angles[:, 2], angles[:, 3])
    return values(brdf, wi, wo), values(brdf, wo, wi)


def warped_pairs(table: Table, theta_max: float) -> tuple[Pairs, float, str]:
    """Random pairs answered by the format's own warp; the error is that of every second incidence, by thirds."""
    material = table.interpolant()
    angles = random_angles(theta_max)
    a, b = _both_ways(material, angles)
    error = 0.0
    if hasattr(material, "vndf") and material.theta_i.shape[0] > 4:
        rougher, _ = _both_ways(half_the_incidences(material), angles)
        error = float(np.max(np.median(relative_difference(a, rougher), axis=0))) / 3
    nothing = np.full_like(a, np.nan)
    return Pairs(a, b, nothing, nothing, angles, len(a)), error, "random pairs, read by the format's own warp"


def half_the_incidences(material):
    """The same warp with every second stored polar angle of incidence, the last one kept."""
    n = material.theta_i.shape[0]
    keep = np.unique(np.append(np.arange(0, n, 2), n - 1))

    def fields(m):
        return m.theta_i, m.vndf, m.conditional, m.marginal, m.spectra

    coarse = (material.theta_i[keep], *(getattr(material, k)[:, keep] for k in ("vndf", "conditional", "marginal")))
    return eqx.tree_at(fields, material, (*coarse, material.spectra[:, keep]))


def interpolated_pairs(table: Table, theta_max: float) -> tuple[Pairs, float, str]:
    """Readings with the interpolated value of their reciprocal pair, and that interpolation's error."""
    from gonio.data.interpolation.multilinear import as_material, interpolation_error

    drawn = table.samples(20_000, theta_max)
    partner = values(as_material(table), drawn.wo, drawn.wi)
    f = np.where(drawn.flag == 0, drawn.f, np.nan).astype(float)
    error = interpolation_error(table, 20_000, theta_max).median
    from gonio.data.layouts import spherical_angles

    angles = np.stack([*spherical_angles(*drawn.wi), *spherical_angles(*drawn.wo)], -1)
    u = np.asarray(drawn.u_f, float)
    # The error of the finer grid is a third of the difference between the two only where both resolve the lobe.
    return Pairs(f, partner, u, u, angles, len(f)), 3 * error, "readings whose partners were interpolated"
