"""Albedos and reflectance factors of a model, with the error of computing them."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from gonio.data.material import Material
from gonio.metrology.fit_numbers import FitNumbers
from gonio.metrology.measurands import (
    ABSORPTANCE,
    ALBEDO,
    BHR,
    FACTOR,
    NAMED,
    STANDARDS,
    THROUGH,
    THROUGH_FACTOR,
    TRANSMITTANCE,
    UNIFORM,
    UNIFORM_THROUGH,
    WHITE_SKY,
    Geometry,
)
from gonio.metrology.quantity import Quantity
from gonio.models.albedo import Estimate
from gonio.models.brdf import AbstractBRDF
from gonio.models.geometry.sides import Hemispheres

INCIDENCES = tuple(range(0, 90, 5))
"""Degrees."""
NODES = 16
GROUPS = {ALBEDO: "albedo", UNIFORM: "albedo", FACTOR: "reflectance", BHR: "remote sensing"}
AZIMUTHS = (0.0, 45.0, 90.0, 135.0)
"""Degrees, of the light over an anisotropic model."""


def model_quantities(
    material: Material, geometries: Sequence[str], numbers: FitNumbers | None = None
) -> list[Quantity]:
    """Directional albedos, the albedo under uniform light, and reflectance factors at named `NAMED` and others.

    Of an anisotropic model the light comes from the azimuth 0; under uniform light from all. Of one that transmits also
    transmittances, what is absorbed, and transmittance factors π f_t with f_t |cosθo|. `numbers`: of the fit whose
    covariance spreads them.
    """
    rows = _rows(material, geometries)
    if numbers is None:
        return rows

    def values(brdf: AbstractBRDF) -> np.ndarray:
        moved = _rows(dataclasses.replace(material, brdf=brdf), geometries, careful=False)
        return np.array([q.value for q in moved]).reshape(-1, len(material.channels))

    spread = numbers.spread(numbers.slopes(values)).ravel()
    return [dataclasses.replace(q, u=float(u)) for q, u in zip(rows, spread, strict=True)]


def _rows(material: Material, geometries: Sequence[str], careful: bool = True) -> list[Quantity]:
    """Those of a model as it is; `careful` False: bounds are not needed."""
    transmits = Hemispheres.TRANSMISSION in material.brdf.hemispheres
    shares = {ALBEDO: material.albedo(INCIDENCES, degrees=True)}
    if transmits:
        r, t = shares[ALBEDO], material.transmittance(INCIDENCES, degrees=True)
        shares |= {TRANSMITTANCE: t, ABSORPTANCE: Estimate(1 - r.value - t.value, r.bound + t.bound, 0)}
    rows = []
    phi = np.zeros(1) if material.brdf.isotropic else np.array(AZIMUTHS)
    for name, share in shares.items():
        for theta, value, bound in zip(INCIDENCES, share.value, share.bound, strict=True):
            rows += _by_channel(material, name, f"θi {theta}°", value, bound, {"theta_i": theta})
    uniform = _uniform_light(material.albedo, phi, careful)
    rows += _by_channel(material, UNIFORM, "", *uniform) + _by_channel(material, BHR, WHITE_SKY, *uniform)
    if transmits:
        through = _uniform_light(material.transmittance, phi, careful)
        rows += _by_channel(material, UNIFORM_THROUGH, "", *through)
    for text in dict.fromkeys([*NAMED, *(THROUGH if transmits else ()), *geometries]):
        rows += _factor(material, Geometry.of(text))
    return rows


def _factor(material: Material, g: Geometry) -> list[Quantity]:
    """The reflectance or transmittance factor at a geometry; of a transmittance f_t |cosθo| too."""
    turn = 0.0 if g.delta_phi is None else g.delta_phi
    angles = {"theta_i": math.degrees(g.theta_i), "theta_o": math.degrees(g.theta_o)}
    angles |= {} if g.delta_phi is None else {"delta_phi": math.degrees(turn)}
    angles = {name: round(angle, 9) for name, angle in angles.items()}
    f = material.f(g.theta_i, 0.0, g.theta_o, turn)
    rows = _by_channel(material, THROUGH_FACTOR if g.through else FACTOR, g.text, np.pi * f, 0 * f, angles)
    if g.through:
        scattered = f * abs(math.cos(g.theta_o))
        rows += [
            dataclasses.replace(row, unit="1/sr")
            for row in _by_channel(material, "scattering function f cosθo", g.text, scattered, 0 * f, angles)
        ]
    return rows


def _by_channel(
    material: Material,
    name: str,
    place: str,
    value: np.ndarray,
    bound: np.ndarray,
    angles: dict[str, float] | None = None,
) -> list[Quantity]:
    columns = zip(material.channels.names, value, bound, strict=True)
    group, standard = GROUPS.get(name, "transmission"), STANDARDS.get(name, "")
    return [
        Quantity(name, place, c, float(v), float(b), dict(angles or {}), standard=standard, group=group)
        for c, v, b in columns
    ]


def _uniform_light(share: Callable[..., Estimate], phi: np.ndarray, careful: bool) -> tuple[np.ndarray, np.ndarray]:
    """∫ of a directional share by sin²θ by Gauss's rule (C,), and how far off: by half as many nodes, and its own."""

    def rule(count: int) -> tuple[np.ndarray, np.ndarray]:
        x, w = np.polynomial.legendre.leggauss(count)
        theta = np.degrees(np.arcsin(np.sqrt((1 + x) / 2)))
        albedos = share(theta[:, None], phi, degrees=True)
        mean = [np.sum(w[:, None] / 2 * a.mean(axis=1), axis=0) for a in (albedos.value, albedos.bound)]
        return mean[0], mean[1]

    rough = rule(NODES // 2)[0]
    if not careful:
        return rough, 0 * rough
    value, bound = rule(NODES)
    return value, bound + np.abs(value - rough)
