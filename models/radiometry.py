"""The radiometric quantities, with symbols and units as data, and the definitions that tie them together.

Pure scalar functions (shapes broadcast). Radiance L in W/(m² sr), irradiance E and exitance M in W/m²,
solid angles in sr, angles in radians, lengths in m.
"""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar


class Quantity(NamedTuple):
    """A radiometric quantity: its symbol, unit and defining differential [ISO 80000-7:2019; CIE S 017]."""

    name: str
    symbol: str
    unit: str
    definition: str


QUANTITIES = {
    q.name: q
    for q in (
        Quantity("energy", "Q", "J", "energy carried by light"),
        Quantity("flux", "Φ", "W", "dQ/dt"),
        Quantity("intensity", "I", "W/sr", "dΦ/dω, of a source into a direction"),
        Quantity("irradiance", "E", "W/m²", "dΦ/dA, arriving on a surface"),
        Quantity("radiant exitance", "M", "W/m²", "dΦ/dA, emitted by a surface"),
        Quantity("radiosity", "J", "W/m²", "dΦ/dA, leaving a surface: emitted and reflected"),
        Quantity("radiance", "L", "W/(m² sr)", "d²Φ/(dA cosθ dω)"),
        Quantity("basic radiance", "L/n²", "W/(m² sr)", "radiance over the refractive index squared"),
        Quantity("BRDF", "f_r", "1/sr", "dL_o/dE_i, reflected radiance for the irradiance from a direction"),
        Quantity("directional albedo", "E(μ)", "1", "∫ f_r cosθ_o dω_o over the hemisphere"),
    )
}


def irradiance(radiance: Scalar, projected_solid_angle: Scalar) -> Scalar:
    """E = L ∫cosθ dω, W/m², of a uniform radiance over a projected solid angle."""
    return radiance * projected_solid_angle


def irradiance_of_cap(radiance: Scalar, half_angle: Scalar) -> Scalar:
    """E = πL sin²s, W/m², of a uniform cap of half-angle s in [0, π/2] about the normal."""
    return jnp.pi * radiance * jnp.sin(half_angle) ** 2


def irradiance_of_sphere(radiance: Scalar, radius: Scalar, distance: Scalar) -> Scalar:
    """E = πL (R/d)², W/m², of a uniform sphere of radius R whose centre is d ≥ R away along the normal."""
    return jnp.pi * radiance * (radius / distance) ** 2


def irradiance_of_point(intensity: Scalar, cos_i: Scalar, distance: Scalar) -> Scalar:
    """E = I cosθ/d², W/m², of a point source of intensity I, W/sr; 0 where it is below the horizon."""
    return intensity * jnp.maximum(cos_i, 0.0) / distance**2


def diffuse_exitance(radiance: Scalar) -> Scalar:
    """M = πL, W/m², of a diffuse emitter: the same radiance in every direction of the hemisphere."""
    return jnp.pi * radiance


def diffuse_radiance(exitance: Scalar) -> Scalar:
    """L = M/π, W/(m² sr), of a diffuse emitter; with M = ρE, the radiance of a diffuse reflector."""
    return exitance / jnp.pi


def solid_angle_of_element(area: Scalar, cos_t: Scalar, distance: Scalar) -> Scalar:
    """dω = dA cosθ/d², sr, subtended by a small area, m², whose normal is at θ from the line of sight."""
    return area * cos_t / distance**2


def etendue(area: Scalar, cos_t: Scalar, solid_angle: Scalar) -> Scalar:
    """dG = dA cosθ dω, m² sr, of a beam: the same at both ends, so radiance is constant along a ray."""
    return area * cos_t * solid_angle


def radiance(flux: Scalar, etendue: Scalar) -> Scalar:
    """L = dΦ/dG, W/(m² sr): the flux of a beam over its étendue."""
    return flux / etendue


def basic_radiance(radiance: Scalar, n: Scalar) -> Scalar:
    """L/n², W/(m² sr): in a medium of index n: unchanged by refraction, but for the part reflected."""
    return radiance / n**2


def radiance_across(radiance: Scalar, n_1: Scalar, n_2: Scalar, transmittance: Scalar = 1.0) -> Scalar:
    """(1 − F) L n2²/n1², W/(m² sr): radiance behind an interface from index n_1 into n_2."""
    return transmittance * radiance * (n_2 / n_1) ** 2


def brdf(radiance_out: Scalar, irradiance_in: Scalar) -> Scalar:
    """f_r = dL_o/dE_i, 1/sr: radiance reflected over the irradiance of the small source that caused it."""
    return radiance_out / irradiance_in


def reflected_radiance(f: Scalar, radiance_in: Scalar, cos_i: Scalar, solid_angle: Scalar) -> Scalar:
    """dL_o = f_r L_i cosθ_i dω_i, W/(m² sr), reflected of the light from a small solid angle."""
    return f * radiance_in * cos_i * solid_angle


def radiosity(exitance: Scalar, rho: Scalar, irradiance: Scalar) -> Scalar:
    """J = M + ρE, W/m²: emitted by, and reflected from, a surface of reflectance ρ in [0, 1]."""
    return exitance + rho * irradiance
