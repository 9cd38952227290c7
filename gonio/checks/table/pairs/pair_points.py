"""Pairs of directions as points whose distances are about the angles between them."""

import numpy as np

from gonio.data.table import Table
from gonio.models.geometry.directions import from_spherical

EXACT = 1e-6
"""Distance, about radians, of two pairs of directions that are one."""

LEAF = 16
"""Points of a leaf of the trees; it decides between neighbours that are equally near."""


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
    return np.stack([*from_spherical(theta_i, phi_i, np), *from_spherical(theta_o, phi_o, np)], -1)
