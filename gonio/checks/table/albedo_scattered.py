"""Directional albedos of scattered tables: by the format's own warp where there is one, else by nearest readings."""

from typing import Any

import numpy as np

from gonio.checks.albedos import Albedos, Incidence, albedos_of
from gonio.checks.direction_search import directions, values
from gonio.checks.grid_resolution import LARGEST
from gonio.checks.table.albedo_on_grid import floor_of
from gonio.checks.table.pairs import angles_of, readings_of
from gonio.checks.table.scattered_pairs import LEAF, isotropic_light, merged, one_sided, warp_of
from gonio.data.table import Table
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.low_discrepancy import low_discrepancy

INCIDENCES = np.radians(np.arange(0.0, 80.1, 10.0))
RULE = (64, 128)
"""Nodes in theta_h and phi_h; half of each is the coarser rule that the error comes from."""

POINTS, MOST_POINTS = 4000, 200_000
"""Directions of the hemisphere, even in projected solid angle, that take the values of the readings near them."""

POINTS_EACH = 8
"""So many of them for each reading, within these limits."""

FARTHEST = np.radians(12.0)
SURROUNDING = 8
"""Nearest readings that have to lie on all sides of a direction for it to count as read."""

MOST_UNCOVERED = 0.1
SAME_LIGHT = np.radians(0.05)
FEWEST = 20


def _half_vector_rule(brdf: AbstractBRDF, n_theta: int, n_phi: int) -> np.ndarray:
    # ∫ f cosθo dωo = ∫ f cosθo 4 (wi·h) dωh, theta_h = u² π/2 so that nodes crowd where lobes are narrow.
    x, w = np.polynomial.legendre.leggauss(n_theta)
    u = (x + 1) / 2
    theta_h, weight = u**2 * np.pi / 2, w / 2 * 2 * u * np.pi / 2
    phi_h = (np.arange(n_phi) + 0.5) * 2 * np.pi / n_phi
    theta_h, phi_h = (a.ravel() for a in np.meshgrid(theta_h, phi_h, indexing="ij"))
    weight = np.repeat(weight, n_phi) * 2 * np.pi / n_phi * np.sin(theta_h)
    h, albedos = directions(theta_h, phi_h), []
    for theta_i in INCIDENCES:
        wi = directions(np.array(theta_i), np.array(0.0))
        facing = wi.x * h.x + wi.y * h.y + wi.z * h.z
        x, y, z = (2 * facing * a - b for a, b in zip(h, wi, strict=True))
        up = (facing > 0) & (z > 1e-9)
        f = values(brdf, wi, Direction(np.where(up, x, 0.0), np.where(up, y, 0.0), np.where(up, z, 1.0)))
        albedos.append(np.sum(np.where(up, weight * 4 * facing * z, 0.0)[:, None] * f, axis=0))
    return np.stack(albedos)


def warped_albedos(table: Table) -> Albedos | str:
    """Albedos of a table that brings its own interpolant, integrated over half vectors at two orders.

    The bound adds to the change between the orders what the readings themselves leave open: every second stored polar
    angle of incidence, and each reading's distance from the mean of its neighbours in the format's own square.
    """
    warp, rough = warp_of(table)
    fine = _half_vector_rule(warp, *RULE)
    bound = 2 * np.abs(fine - _half_vector_rule(warp, *(n // 2 for n in RULE)))
    if hasattr(warp, "spectra"):
        bound = bound + np.abs(fine) * _error_between(np.asarray(warp.spectra, float))
    if rough is not None:
        bound = bound + np.abs(fine - _half_vector_rule(rough, *RULE)) / 3
    rows = (Incidence(t, 0.0, v, b, np.zeros_like(v)) for t, v, b in zip(INCIDENCES, fine, bound, strict=True))
    return albedos_of(rows, "Integrated over half vectors, the values read by the format's own warp.")


def _error_between(spectra: np.ndarray) -> np.ndarray:
    # A quarter of each node's distance from its neighbours' mean, in units of the mean: a linear rule's error.
    mean = np.maximum(np.abs(spectra.mean(axis=(0, 1, 2, 3))), 1e-300)
    total = 0.0
    for axis in (2, 3):
        middle = np.moveaxis(spectra, axis, 0)
        bend = middle[1:-1] - (middle[:-2] + middle[2:]) / 2
        total = total + np.abs(bend).mean(axis=(0, 1, 2, 3)) / 4
    return total / mean


def scattered_albedos(table: Table, reach: float, bend: float = 1.0) -> Albedos | str:
    """Albedos at the incidences of a scattered table whose readings cover the hemisphere, by nearest readings.

    `reach` and `bend` as of `gonio.checks.table.albedo_on_grid.grid_albedos`.
    """
    cells = np.arange(table.layout.size)
    angles = angles_of(table.layout, cells)
    f, u = readings_of(table, cells)
    use = np.isfinite(f).all(axis=1) & (angles[:, 0] < np.pi / 2)
    angles, f, u = angles[use], f[use], np.nan_to_num(u[use])
    isotropic = isotropic_light(table)
    key = angles[:, :1] if isotropic else np.where(angles[:, :1] < 1e-9, 0.0, angles[:, :2])
    groups = np.unique(np.round(key / SAME_LIGHT).astype(int), axis=0, return_inverse=True)[1].ravel()
    alike = (groups == g for g in range(groups.max(initial=-1) + 1))
    mirrored = isotropic and one_sided(angles)
    rows = [_nearest((angles[one], f[one], u[one]), mirrored, reach, bend) for one in alike]
    how = ", taking the surface as isotropic and mirror symmetric" if mirrored else ""
    albedos = albedos_of(rows, f"Integrated with the value of the nearest reading in each direction{how}.")
    none = isinstance(albedos, str) or not albedos.value.any()
    return "at no incidence do its readings cover the hemisphere" if none else albedos


def _nearest(
    readings: tuple[np.ndarray, np.ndarray, np.ndarray], mirrored: bool, reach: float, bend: float
) -> Incidence:
    """The albedo of one incidence, of readings (angles, f, u)."""
    from scipy.spatial import KDTree

    angles, f, u = readings
    theta_i, phi_i = float(np.median(angles[:, 0])), float(angles[0, 1])
    # Several readings of one direction, as of the normal, are one: its neighbours are those of other directions.
    angles, f, u, *_ = merged(angles, f, u, _outgoing(angles, mirrored))
    nothing = np.zeros(f.shape[1])
    if len(f) < FEWEST:
        return Incidence(theta_i, phi_i, nothing, nothing, nothing, partial=True)
    points = int(np.clip(POINTS_EACH * len(f), POINTS, MOST_POINTS))
    point = low_discrepancy(points, 2)
    theta, phi = np.arcsin(np.sqrt(point[:, 0])), 2 * np.pi * point[:, 1]
    wanted = np.stack([np.full(points, theta_i), np.full(points, phi_i), theta, phi], -1)
    tree = KDTree(_outgoing(angles, mirrored), LEAF)
    distance, near = (np.asarray(a) for a in tree.query(_outgoing(wanted, mirrored), k=4))
    uncovered = distance[:, 0] > FARTHEST
    partial = bool(uncovered.mean() > MOST_UNCOVERED)
    here, around = f[near[:, 0]], f[near]
    if partial:  # what was read alone
        here = np.where((uncovered | ~_surrounded(_outgoing(wanted, mirrored), tree))[:, None], 0.0, here)
    value = np.pi * here.mean(axis=0)
    floor = floor_of(value)
    spread = np.minimum(np.ptp(np.log(np.maximum(around, floor)), axis=1), LARGEST)
    error = np.maximum(np.abs(here), floor) * np.expm1(spread) / 2
    error = np.where(uncovered[:, None], np.maximum(error, np.abs(here)), error)
    counts = np.bincount(near[:, 0], minlength=len(f))[:, None] * np.pi / points
    noise = np.sqrt(np.sum((counts * u) ** 2, axis=0))
    lobe = theta_i if bend == 1.0 else np.arcsin(min(bend * np.sin(theta_i), 1.0))
    mirror = np.array([[theta_i, phi_i, lobe, phi_i + np.pi]])
    unseen = bool(tree.query(_outgoing(mirror, mirrored))[0][0] > reach)
    return Incidence(theta_i, phi_i, value, np.pi * error.mean(axis=0) + 2 * noise, noise, unseen, partial=partial)


def _outgoing(angles: np.ndarray, mirrored: bool) -> np.ndarray:
    theta, phi = angles[:, 2], angles[:, 3] - angles[:, 1]
    if mirrored:
        phi = np.abs(np.mod(phi + np.pi, 2 * np.pi) - np.pi)
    return np.stack(directions(theta, phi), -1)


def _surrounded(points: np.ndarray, tree: Any) -> np.ndarray:
    """Whether directions, (n, 3), have near readings on all sides: no half plane about them is without one."""
    _, near = tree.query(points, k=min(SURROUNDING, tree.n))
    offset = tree.data[near] - points[:, None]
    across = np.cross(points, np.where(np.abs(points[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    along = np.cross(points, across)
    x, y = (np.einsum("nkc,nc->nk", offset, axis) for axis in (across, along))
    angle = np.sort(np.arctan2(y, x), axis=1)
    gaps = np.diff(angle, axis=1, append=angle[:, :1] + 2 * np.pi)
    return gaps.max(axis=1) < np.pi
