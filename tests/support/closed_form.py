"""BRDFs that are plain polynomials of both directions, by which files are made and tables judged, without gonio."""

from collections.abc import Callable

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Table

BRDF = Callable[[np.ndarray, np.ndarray], np.ndarray]


def vector(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Unit vectors (3, n) of polar angles and azimuths, radians."""
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def isotropic(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """A BRDF that tells the side of the light from the mirror's, and light from detector; 1/sr."""
    return 0.3 + 0.1 * (wi * wo).sum(0) + 0.05 * wi[2] + 0.02 * wo[2]


def anisotropic(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """A BRDF that tells every direction from every other, and from its mirror images; 1/sr."""
    return isotropic(wi, wo) + 0.03 * wi[0] + 0.04 * wo[1] + 0.015 * wi[1] * wo[0]


def pairs(count: int, seed: int, theta_max: float = 1.4) -> tuple[np.ndarray, ...]:
    """theta_i, phi_i, theta_o, phi_o of random directions, radians, (count,)."""
    rng = np.random.default_rng(seed)
    return tuple(rng.uniform(0.01, high, count) for high in (theta_max, 6.2, theta_max, 6.2))


def largest_error(table: Table, brdf: BRDF, channel: int = 0) -> float:
    """Of the valid readings of a channel, relative to the BRDF where their layout says that they are."""
    theta_i, phi_i, theta_o, phi_o = table.layout.angles()
    values = table.read_values()
    valid = values["flag"][:, channel] == Flag.VALID
    assert valid.any()
    expected = brdf(vector(theta_i, phi_i), vector(theta_o, phi_o))
    return float(np.abs(values["f"][:, channel] / expected - 1)[valid].max())
