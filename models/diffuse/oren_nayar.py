"""Oren and Nayar's rough diffuser: V-cavities of Lambertian facets."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.warps.grazing_azimuth import TANGENT_MAX, polar_parts
from gonio.models.warps.hemisphere import beside

FACET_ALBEDO = ParameterInfo(0.0, 1.0, "1", "albedo of a facet", start=0.5, role="albedo", per_channel=True)
SLOPE_ANGLE = ParameterInfo(
    0.0, 1.5707963267948966, "rad", "standard deviation of the facets' slope angle", start=0.3, role="roughness"
)


class OrenNayar(AbstractBRDF):
    """f = ρ/π (C1 + cosφ C2 tanβ + (1−|cosφ|) C3 tan((α+β)/2)) + twice scattered light [Oren & Nayar 1994].

    α and β are the larger and the smaller polar angle, φ the difference of azimuths. `form`: "full" (the default) is
    the functional model, with 0.17 ρ²/π σ²/(σ²+0.13) (1 − cosφ (2β/π)²) for two scatterings; "qualitative" the short
    ρ/π (A + B max(0, cosφ) sinα tanβ), A = 1 − ½σ²/(σ²+0.33) and B = 0.45 σ²/(σ²+0.09), the one in common use.
    """

    violates: ClassVar = {
        "energy": "white facets gain at grazing: the full form has the albedo 1.027 at μ = 0.1 and 1.043 at μ = 0.02 "
        "with σ = 0.3, the qualitative 1.015 with σ = 0.2",
        "positivity": "the full form of dark facets is below 0 for opposite grazing directions where σ > 0.66, down to "
        "−0.27 ρ/π",
    }

    rho: Channels = parameter(FACET_ALBEDO)
    sigma: Channels = parameter(SLOPE_ANGLE)
    form: str = eqx.field(static=True, default="full", metadata={"choices": ("full", "qualitative")})

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        shape = self._full(wi, wo) if self.form == "full" else self._qualitative(wi, wo)
        return self.rho / jnp.pi * shape

    def _qualitative(self, wi: Direction, wo: Direction) -> Channels:
        s2 = self.sigma**2
        # cosφ sinα tanβ = (wi·wo − μi μo)/max(μi, μo).
        turned = jnp.maximum(wi.x * wo.x + wi.y * wo.y, 0.0) / jnp.maximum(wi.z, wo.z)
        return 1.0 - 0.5 * s2 / (s2 + 0.33) + 0.45 * s2 / (s2 + 0.09) * turned

    def _full(self, wi: Direction, wo: Direction) -> Channels:
        s2 = self.sigma**2
        (sin_i, cx_i, cy_i), (sin_o, cx_o, cy_o) = polar_parts(wi), polar_parts(wo)
        sin_a, cos_a, sin_b, cos_b = _larger_angle(sin_i, wi.z, sin_o, wo.z)
        cos_phi = cx_i * cx_o + cy_i * cy_o
        # cosφ tanβ (sinα − (2β/π)³), the bracket where cosφ < 0 as a difference of what each lacks to 1.
        share_a, share_b = (1.0 - 2.0 / jnp.pi * jnp.arctan2(c, s) for c, s in ((cos_a, sin_a), (cos_b, sin_b)))
        lacking = 2.0 / jnp.pi * jnp.arctan2(cos_b, sin_b) * (1.0 + share_b + share_b**2) - cos_a**2 / (1.0 + sin_a)
        aligned = wi.x * wo.x + wi.y * wo.y
        along = jnp.where(aligned < 0, cos_phi * sin_b * lacking, aligned) / cos_b
        side = jnp.where(cos_phi < 0, -1.0, 1.0)
        turned = 0.5 * ((cx_i - side * cx_o) ** 2 + (cy_i - side * cy_o) ** 2)  # 1 − |cosφ|, to its last digits
        across = turned * (share_a * share_b) ** 2 * ((sin_i + sin_o) / (wi.z + wo.z))  # tan((α+β)/2)
        grown = s2 / (s2 + 0.09)
        once = 1.0 - 0.5 * s2 / (s2 + 0.33) + 0.45 * grown * along + 0.125 * grown * across
        twice = 0.17 * s2 / (s2 + 0.13) * (1.0 - cos_phi * share_b**2)
        return once + self.rho * twice

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Azimuths from that of wi, so that cosφ changes sign at u1 = ¼ and ¾; heights over the horizon cut at wi's.

        Above it the sum of both heights grows exponentially, as 1/(μi + μo) is narrow at grazing; below, equal steps.
        """
        height_i = jnp.arctan2(jnp.maximum(wi.z, 1.0 / TANGENT_MAX), polar_parts(wi)[0])
        growth = jnp.log((0.5 * jnp.pi + height_i) / (2.0 * height_i))
        inner = u2 < 0.5
        grown = 2.0 * height_i * jnp.exp(growth * jnp.where(inner, 1.0 - 2.0 * u2, 0.0))
        height = jnp.where(inner, grown - height_i, 2.0 * height_i * (1.0 - u2))
        rate = jnp.where(inner, 2.0 * growth * grown, 2.0 * height_i)
        return beside(wi, u1, jnp.cos(height), jnp.sin(height)), 2 * jnp.pi * jnp.cos(height) * rate


def _larger_angle(sin_i: Scalar, cos_i: Scalar, sin_o: Scalar, cos_o: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    # (sinα, cosα, sinβ, cosβ) of the larger and the smaller polar angle.
    return jnp.maximum(sin_i, sin_o), jnp.minimum(cos_i, cos_o), jnp.minimum(sin_i, sin_o), jnp.maximum(cos_i, cos_o)
