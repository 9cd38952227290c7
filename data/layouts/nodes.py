"""Angles of directions, and nodes of an axis by their angle."""

import numpy as np

SAME = 1e-9
"""Angles of nodes that differ by less than this many radians are one."""


def node_numbers(axis: np.ndarray, angles: np.ndarray, period: float | None = None) -> np.ndarray:
    """Number of the node of an increasing axis at each angle (modulo the period), or −1 where there is none."""
    if period is not None:
        angles = np.mod(angles - axis[0] + SAME, period) + axis[0] - SAME
    upper = np.clip(np.searchsorted(axis, angles), 1, max(axis.size - 1, 1))
    low, high = upper - 1, np.minimum(upper, axis.size - 1)
    nearest = np.where(np.abs(axis[low] - angles) <= np.abs(axis[high] - angles), low, high)
    return np.where(np.abs(axis[nearest] - angles) <= SAME, nearest, -1)


def spherical_angles(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(theta in [0, π], phi in [0, 2π)), radians, of directions by their components (NumPy)."""
    phi = np.arctan2(y, x) % (2 * np.pi)
    return np.arctan2(np.hypot(x, y), z), np.where(phi >= 2 * np.pi, 0.0, phi)
