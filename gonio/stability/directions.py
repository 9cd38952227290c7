"""Pairs of directions where formulas break: towards the mirror, back to the light, the normal, and the horizon."""

import numpy as np

COLUMNS = {
    "0°": 0.0, "30°": np.radians(30), "60°": np.radians(60), "80°": np.radians(80), "89°": np.radians(89),
    "89.99°": np.radians(89.99), "cos 1e-8": np.arccos(1e-8), "cos 1e-15": np.arccos(1e-15),
}  # fmt: skip
"""Incidences by their names, radians."""

AZIMUTH = 0.3
"""Azimuth of every incidence, radians."""
NEAR = (1e-4, 1e-3, 1e-2, 0.1)


def unit_vector(theta: float | np.ndarray, phi: float | np.ndarray = AZIMUTH) -> np.ndarray:
    """Components (3,) or (3, n) of directions by their angles, radians."""
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


BEHIND = np.array([1.0, 1.0, -1.0])


def pairs(column: str, transmits: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """(wi, wo), unit vectors of shape (n, 3), of one incidence: the first is the exact mirror, the second the retro.

    `transmits`: and again with the detector behind, so that the mirror is straight through, and with the light behind.
    """
    wi, wo = _pairs_in_front(column)
    if not transmits:
        return wi, wo
    return np.concatenate([wi, wi, wi * BEHIND]), np.concatenate([wo, wo * BEHIND, wo])


def _pairs_in_front(column: str) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = COLUMNS[column], AZIMUTH
    wi = unit_vector(theta, phi)
    wo = [wi * [-1.0, -1.0, 1.0], wi, unit_vector(0.0)]
    for step in NEAR:
        wo.append(unit_vector(np.clip(theta - step, 0, np.pi / 2), phi + np.pi))
        wo.append(unit_vector(theta, phi + np.pi + step))
    wo += [
        unit_vector(np.clip(theta - 0.02, 0, 1.57), phi + 0.01),
        unit_vector(0.8, phi + np.pi / 2),
        unit_vector(1.2, 2.0),
    ]
    wo += [unit_vector(np.radians(t), phi + p) for t in (89.9, 89.9999) for p in (np.pi, 2.0)]
    wo += [unit_vector(np.arccos(1e-12), phi + p) for p in (np.pi, 0.0)]
    return np.tile(wi, (len(wo), 1)), np.stack(wo)
