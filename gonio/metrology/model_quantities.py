"""Albedos and reflectance factors of a model, with the error of computing them."""

import math
from collections.abc import Sequence

import numpy as np

from gonio.data.material import Material
from gonio.metrology.measurands import ALBEDO, FACTOR, NAMED, UNIFORM, Geometry, Quantity

INCIDENCES = tuple(range(0, 90, 5))
"""Degrees."""
NODES = 16
AZIMUTHS = (0.0, 45.0, 90.0, 135.0)
"""Degrees, of the light over an anisotropic model."""


def model_quantities(material: Material, geometries: Sequence[str]) -> list[Quantity]:
    """Directional albedos, the albedo under uniform light, and reflectance factors at named `NAMED` and others.

    Of an anisotropic model the light comes from the azimuth 0; under uniform light from all.
    """
    names, rows = material.channels.names, []
    albedos = material.albedo(INCIDENCES, degrees=True)
    for k, theta in enumerate(INCIDENCES):
        values = zip(names, albedos.value[k], albedos.bound[k], strict=True)
        rows += [Quantity(ALBEDO, f"θi {theta}°", c, float(v), float(b), {"theta_i": theta}) for c, v, b in values]
    uniform = zip(names, *_uniform_light(material), strict=True)
    rows += [Quantity(UNIFORM, "", c, float(v), float(b)) for c, v, b in uniform]
    for text in dict.fromkeys([*NAMED, *geometries]):
        g = Geometry.of(text)
        turn = 0.0 if g.delta_phi is None else g.delta_phi
        angles = {"theta_i": math.degrees(g.theta_i), "theta_o": math.degrees(g.theta_o)}
        angles |= {} if g.delta_phi is None else {"delta_phi": math.degrees(turn)}
        angles = {name: round(angle, 9) for name, angle in angles.items()}
        f = np.pi * material.f(g.theta_i, 0.0, g.theta_o, turn)
        rows += [Quantity(FACTOR, g.text, c, float(v), 0.0, angles) for c, v in zip(names, f, strict=True)]
    return rows


def _uniform_light(material: Material) -> tuple[np.ndarray, np.ndarray]:
    """∫ E d(sin²θ) by Gauss's rule (C,), and how far off: the change from half as many nodes, and the albedos' own."""
    phi = np.zeros(1) if material.brdf.isotropic else np.array(AZIMUTHS)

    def rule(count: int) -> tuple[np.ndarray, np.ndarray]:
        x, w = np.polynomial.legendre.leggauss(count)
        theta = np.degrees(np.arcsin(np.sqrt((1 + x) / 2)))
        albedos = material.albedo(theta[:, None], phi, degrees=True)
        mean = [np.sum(w[:, None] / 2 * a.mean(axis=1), axis=0) for a in (albedos.value, albedos.bound)]
        return mean[0], mean[1]

    (value, bound), (rough, _) = rule(NODES), rule(NODES // 2)
    return value, bound + np.abs(value - rough)
