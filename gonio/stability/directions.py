"""Pairs of directions where formulas break: towards the mirror, back to the light, the normal, and the horizon."""

import numpy as np

COLUMNS = {
    "0°": 0.0,
    "30°": np.radians(30),
    "60°": np.radians(60),
    "80°": np.radians(80),
    "89°": np.radians(89),
    "89.99°": np.radians(89.99),
    "cos 1e-8": np.arccos(1e-8),
    "cos 1e-15": np.arccos(1e-15),
}
"""Incidences by their names, radians."""

AZIMUTH = 0.3
NEAR = (1e-4, 1e-3, 1e-2, 0.1)


def _direction(theta, phi):
    return np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), -1)


def pairs(column: str) -> tuple[np.ndarray, np.ndarray]:
    """(wi, wo), unit vectors of shape (n, 3), of one incidence: the first is the exact mirror, the second the retro."""
    theta, phi = COLUMNS[column], AZIMUTH
    wi = _direction(theta, phi)
    mirror = wi * [-1.0, -1.0, 1.0]
    wo = [mirror, wi, np.array([0.0, 0.0, 1.0])]
    for step in NEAR:
        wo.append(_direction(np.clip(theta - step, 0, np.pi / 2), phi + np.pi))
        wo.append(_direction(theta, phi + np.pi + step))
    wo += [
        _direction(np.clip(theta - 0.02, 0, 1.57), phi + 0.01),
        _direction(0.8, phi + np.pi / 2),
        _direction(1.2, 2.0),
    ]
    wo += [_direction(np.radians(t), phi + p) for t in (89.9, 89.9999) for p in (np.pi, 2.0)]
    wo += [_direction(np.arccos(1e-12), phi + p) for p in (np.pi, 0.0)]
    wo = np.stack(wo)
    return np.broadcast_to(wi, wo.shape).copy(), wo
