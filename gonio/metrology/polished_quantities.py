"""What is stated of polished surfaces: the specular reflectance, the scattered share, the roughness of a band."""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from gonio.data.material import Material
from gonio.metrology.quantity import Quantity
from gonio.models.brdf import terms
from gonio.models.geometry.directions import Direction, from_spherical
from gonio.models.surface_scatter.rayleigh_rice import RayleighRice, total_integrated_scatter

INCIDENCES = (0, 45, 75)
"""Degrees."""


def polished_quantities(material: Material) -> list[Quantity]:
    """Specular reflectance, total integrated scatter and its approximation, rms height; none of other materials.

    The total integrated scatter is what is scattered, of all that is reflected; (4πσ cosθi/λ)² is for small roughness.
    """
    surface = next((t for t in terms(material.brdf) if isinstance(t, RayleighRice)), None)
    if surface is None and not _mirrors(material):
        return []
    names, rows = material.channels.names, []
    theta = np.radians(INCIDENCES)
    wi = Direction(*(jnp.asarray(c) for c in from_spherical(theta, np.zeros_like(theta), np)))
    shape = (theta.size, len(names))
    specular = np.broadcast_to(
        np.asarray(jax.vmap(material.brdf.mirror_reflectance)(wi)).reshape(theta.size, -1), shape
    )
    scattered = material.albedo(theta)
    for k, angle in enumerate(INCIDENCES):
        place, angles = f"θi {angle}°", {"theta_i": float(angle)}
        whole = specular[k] + scattered.value[k]
        for c, name in enumerate(names):
            share, bound = (float(a[k, c] / whole[c]) for a in (scattered.value, scattered.bound))
            rows += [
                Quantity("specular reflectance", place, name, float(specular[k, c]), 0.0, angles),
                Quantity("total integrated scatter", place, name, share, bound, angles),
            ]
    rows = rows if surface is None else [*rows, *_of_small_roughness(surface, names)]
    return [dataclasses.replace(row, group="scatter") for row in rows]


def _mirrors(material: Material) -> bool:
    """Whether a part of the light leaves as an image of its source, as of a polished surface under a coat."""
    normal = Direction(*(jnp.asarray(c) for c in (0.0, 0.0, 1.0)))
    return bool(np.any(np.asarray(material.brdf.mirror_reflectance(normal)) > 0))


def _of_small_roughness(surface: RayleighRice, names: Sequence[str]) -> list[Quantity]:
    """(4πσ cosθi/λ)² at all incidences, and σ itself."""
    sigma, rows = np.asarray(surface.rms_height()), list[Quantity]()
    for angle in INCIDENCES:
        small = total_integrated_scatter(sigma, surface.wavelength, np.cos(np.radians(angle)))
        each = np.broadcast_to(np.atleast_1d(np.asarray(small)), len(names))
        place, angles = f"θi {angle}°", {"theta_i": float(angle)}
        rows += [Quantity("(4πσ cosθi/λ)²", place, n, float(v), 0.0, angles) for n, v in zip(names, each, strict=True)]
    heights = np.broadcast_to(np.atleast_1d(sigma), len(names))
    rows += [
        Quantity("rms height, µm", "up to 1/λ", name, float(h), 0.0, unit="µm")
        for name, h in zip(names, heights, strict=True)
    ]
    return rows
