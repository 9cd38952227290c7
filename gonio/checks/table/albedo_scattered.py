"""Directional albedos of scattered tables: by the format's own warp where there is one, else by nearest readings."""

import numpy as np

from gonio.checks.direction_search import directions, values
from gonio.checks.grid_resolution import LARGEST
from gonio.checks.table.albedo_on_grid import Albedos, no_albedo
from gonio.checks.table.pairs import angles_of, gathered
from gonio.checks.table.scattered_pairs import half_the_incidences, isotropic_light
from gonio.data.table import Table
from gonio.models.geometry.low_discrepancy import low_discrepancy

INCIDENCES = np.radians(np.arange(0.0, 80.1, 10.0))
RULE = (64, 128)
"""Nodes in theta_h and phi_h; half of each is the coarser rule that the error comes from."""

POINTS = 4000
"""Directions of the hemisphere, even in projected solid angle, that take the values of the readings near them."""

FARTHEST = np.radians(12.0)
MOST_UNCOVERED = 0.1
SAME_LIGHT = np.radians(0.05)
FEWEST = 20


def _half_vector_rule(brdf, theta_i, n_theta, n_phi):
    # ∫ f cosθo dωo = ∫ f cosθo 4 (wi·h) dωh, theta_h = u² π/2 so that nodes crowd where lobes are narrow.
    x, w = np.polynomial.legendre.leggauss(n_theta)
    u = (x + 1) / 2
    theta_h, weight = u**2 * np.pi / 2, w / 2 * 2 * u * np.pi / 2
    phi_h = (np.arange(n_phi) + 0.5) * 2 * np.pi / n_phi
    theta_h, phi_h = (a.ravel() for a in np.meshgrid(theta_h, phi_h, indexing="ij"))
    weight = np.repeat(weight, n_phi) * 2 * np.pi / n_phi * np.sin(theta_h)
    wi, h = directions(np.array(theta_i), np.array(0.0)), directions(theta_h, phi_h)
    facing = wi.x * h.x + wi.y * h.y + wi.z * h.z
    wo = type(h)(*(2 * facing * a - b for a, b in zip(h, wi, strict=True)))
    up = (facing > 0) & (wo.z > 1e-9)
    wo = type(wo)(*(np.where(up, c, e) for c, e in zip(wo, (0.0, 0.0, 1.0), strict=True)))
    f = values(brdf, wi, wo)
    return np.sum(np.where(up, weight * 4 * facing * wo.z, 0.0)[:, None] * f, axis=0)


def warped_albedos(table: Table) -> Albedos:
    """Albedos of a table that brings its own interpolant, integrated over half vectors at two orders.

    The bound adds to the change between the orders what the readings themselves leave open: every second stored polar
    angle of incidence, and each reading's distance from the mean of its neighbours in the format's own square.
    """
    material = table.interpolant()
    fine = np.stack([_half_vector_rule(material, t, *RULE) for t in INCIDENCES])
    coarse = np.stack([_half_vector_rule(material, t, *(n // 2 for n in RULE)) for t in INCIDENCES])
    bound = 2 * np.abs(fine - coarse)
    method = "Integrated over half vectors, the values read by the format's own warp."
    if hasattr(material, "spectra"):
        bound = bound + np.abs(fine) * _open_between(np.asarray(material.spectra, float))
        if material.theta_i.shape[0] > 4:
            rough = half_the_incidences(material)
            bound = bound + np.abs(fine - np.stack([_half_vector_rule(rough, t, *RULE) for t in INCIDENCES])) / 3
    n = INCIDENCES.size
    return Albedos(INCIDENCES, np.zeros(n), fine, bound, bound, np.zeros_like(fine), np.zeros(n, bool), method)


def _open_between(spectra):
    # A quarter of each node's distance from its neighbours' mean, in units of the mean: a linear rule's error.
    mean = np.maximum(np.abs(spectra.mean(axis=(0, 1, 2, 3))), 1e-300)
    total = 0.0
    for axis in (2, 3):
        middle = np.moveaxis(spectra, axis, 0)
        bend = middle[1:-1] - (middle[:-2] + middle[2:]) / 2
        total = total + np.abs(bend).mean(axis=(0, 1, 2, 3)) / 4
    return total / mean


def scattered_albedos(table: Table, reach: float) -> Albedos:
    """Albedos at the incidences of a scattered table whose readings cover the hemisphere, by nearest readings."""
    cells = np.arange(table.layout.size)
    angles = angles_of(table.layout, cells)
    f, u = gathered(table, cells)
    use = np.isfinite(f).all(axis=1) & (angles[:, 0] < np.pi / 2)
    angles, f, u = angles[use], f[use], u[use]
    isotropic = isotropic_light(table)
    key = angles[:, :1] if isotropic else np.where(angles[:, :1] < 1e-9, 0.0, angles[:, :2])
    groups = np.unique(np.round(key / SAME_LIGHT).astype(int), axis=0, return_inverse=True)[1].ravel()
    found = []
    for g in range(groups.max(initial=-1) + 1):
        one = groups == g
        if np.count_nonzero(one) >= FEWEST:
            found.append(_nearest(angles[one], f[one], np.nan_to_num(u[one]), isotropic, reach))
    found = [o for o in found if o is not None]
    if not found:
        return no_albedo("at no incidence do its readings cover the hemisphere")
    theta, phi, value, bound, noise, unseen = (np.stack(c) for c in zip(*found, strict=True))
    above = np.where(unseen[:, None], np.inf, bound)
    method = "Integrated with the value of the nearest reading in each direction"
    method += ", taking the surface as isotropic and mirror symmetric." if isotropic else "."
    return Albedos(theta, phi, value, above, bound, noise, unseen, method)


def _nearest(angles, f, u, isotropic, reach):
    from scipy.spatial import cKDTree

    theta_i, phi_i = float(np.median(angles[:, 0])), float(angles[0, 1])
    point = low_discrepancy(POINTS, 2)
    asked = np.stack(
        [np.full(POINTS, theta_i), np.full(POINTS, phi_i), np.arcsin(np.sqrt(point[:, 0])), 2 * np.pi * point[:, 1]], -1
    )
    tree = cKDTree(_outgoing(angles, isotropic))
    distance, near = tree.query(_outgoing(asked, isotropic), k=4)
    uncovered = distance[:, 0] > FARTHEST
    if uncovered.mean() > MOST_UNCOVERED:
        return None
    here, around = f[near[:, 0]], f[near]
    value = np.pi * here.mean(axis=0)
    floor = np.maximum(1e-3 * np.abs(value) / np.pi, 1e-300)
    logs = np.log(np.maximum(around, floor))
    spread = np.minimum(np.ptp(logs, axis=1), LARGEST)
    error = np.maximum(np.abs(here), floor) * np.expm1(spread) / 2
    error = np.where(uncovered[:, None], np.maximum(error, np.abs(here)), error)
    counts = np.bincount(near[:, 0], minlength=len(f))[:, None] * np.pi / POINTS
    noise = np.sqrt(np.sum((counts * u) ** 2, axis=0))
    mirror = np.array([[theta_i, phi_i, theta_i, phi_i + np.pi]])
    unseen = tree.query(_outgoing(mirror, isotropic))[0][0] > reach
    return theta_i, phi_i, value, np.pi * error.mean(axis=0) + 2 * noise, noise, unseen


def _outgoing(angles, isotropic):
    theta, phi = angles[:, 2], angles[:, 3] - angles[:, 1]
    if isotropic:
        phi = np.abs(np.mod(phi + np.pi, 2 * np.pi) - np.pi)
    return np.stack(directions(theta, phi), -1)
