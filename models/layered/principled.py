"""Disney's principled model."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import (
    AbstractBRDF,
    AbstractComposite,
    Channels,
    Direction,
    ParameterInfo,
    Sample,
    Scalar,
    known_equal,
    parameter,
)
from gonio.models.fresnel import fresnel_dielectric
from gonio.models.geometry.directions import reflect
from gonio.models.geometry.half_vector import half_angles, mirrored_pdf
from gonio.models.microfacet.distributions import ggx_cos_over_g1, ggx_d, ggx_visible_normal
from gonio.models.parameters import Role
from gonio.models.warps.hemisphere import rough_diffuser_map
from gonio.models.warps.slopes import facet_direction, slope_ray

LEAST_ALPHA = 1e-3  # Burley's code: a perfect mirror is not meant
CLEARCOAT_SMITH = 0.25  # the width in the clearcoat's masking, whatever its gloss
LUMINANCE = {"disney": (0.3, 0.6, 0.1), "mitsuba": (0.212671, 0.715160, 0.072169)}


def _share(doc: str, start: float, role: Role = "weight", per_channel: bool = False) -> ParameterInfo:
    return ParameterInfo(0.0, 1.0, "1", doc, start=start, role=role, per_channel=per_channel)


def schlick_weight(cosine: Scalar) -> Scalar:
    """(1 − cosine)⁵."""
    m = jnp.clip(1.0 - cosine, 0.0, 1.0)
    return (m * m) ** 2 * m


def gtr1_d(m: Direction, alpha: Scalar) -> Scalar:
    """(α² − 1)/(π ln α² (sin²θ + α² cos²θ)), 1/sr, for 0 < α < 1 [Burley 2012, eq. 4 with γ = 1].

    `gonio.models.microfacet.gtr.gtr_d` of γ = 1, without its logarithms of each direction.
    """
    spread = m.x**2 + m.y**2 + (alpha * m.z) ** 2
    return jnp.where(m.z > 0, (alpha * alpha - 1.0) / (2.0 * jnp.pi * jnp.log(alpha) * spread), 0.0)


def _mix(a: Scalar, b: Scalar, t: Scalar) -> Scalar:
    return a + (b - a) * t


class PrincipledTerm(AbstractBRDF):
    """One of the three terms of a principled model: "diffuse" (with the sheen), "specular" or "clearcoat"."""

    whole: "Principled"
    term: str = eqx.field(static=True)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return getattr(self.whole, f"_{self.term}")(wi, wo)

    @property
    def _widths(self) -> tuple[Scalar, Scalar]:
        alpha_x, alpha_y = self.whole.widths if self.term == "specular" else (self.whole.clearcoat_alpha,) * 2
        return jnp.mean(alpha_x), jnp.mean(alpha_y)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        if self.term == "diffuse":
            return super().sample(wi, u1, u2)
        if self.term == "specular":
            return reflect(wi, ggx_visible_normal(wi, *self._widths, u1, u2)), True
        a2 = self._widths[0] ** 2
        sin2 = jnp.clip((a2 ** (1.0 - u2) - a2) / (1.0 - a2), 0.0, 1.0)  # [Burley 2012, eq. 5]
        sin, phi = jnp.sqrt(sin2), 2 * jnp.pi * u1
        return reflect(wi, Direction(sin * jnp.cos(phi), sin * jnp.sin(phi), jnp.sqrt(1.0 - sin2))), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        if self.term == "diffuse":
            return super().pdf(wi, wo)
        if self.term == "specular":
            h = half_angles(wi, wo).h
            return 0.25 * ggx_d(h, *self._widths) / ggx_cos_over_g1(wi, *self._widths)
        return mirrored_pdf(lambda m: gtr1_d(m, self._widths[0]) * m.z, wi, wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        if self.term == "diffuse":
            return rough_diffuser_map(wi, u1, u2)
        ray = slope_ray(wi, u1, *self._widths)
        span = jnp.arcsinh(ray.horizon)
        return facet_direction(wi, ray, jnp.sinh(span * u2), jnp.cosh(span * u2) * span, *self._widths)

    @property
    def isotropic(self) -> bool:
        return self.whole.isotropic

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return None if self.term == "diffuse" else self._widths


class Principled(AbstractComposite):
    """f = (1 − metallic)(diffuse + sheen) + F D G/(4 cosθi cosθo) + clearcoat/4 · F D₁ G/(4 ...) [Burley 2012].

    As Burley's code defines it (wdas/brdf, disney.brdf), but for `base_color`, which is linear here: there it is raised
    to 2.2. α = roughness², divided and multiplied by √(1 − 0.9 anisotropic) along x and y. Tints divide by the
    luminance 0.3 R + 0.6 G + 0.1 B of three channels, by the mean of another number.
    `variant` "mitsuba": Mitsuba 3's code, with exact Fresnel in the untinted dielectric part (Schlick here), Rec. 709's
    luminance, and a clearcoat without the 1/(4 cosθi cosθo); `subsurface` is its flatness. Its defaults differ:
    sheen_tint and clearcoat_gloss are 0 there.
    """

    violates: ClassVar = {
        "energy": "White and of roughness 1 it reflects 1.05 at normal incidence, 1.60 at 89.99°; sheen and coat add."
    }

    base_color: Channels = parameter(_share("albedo, linear", 0.5, "albedo", per_channel=True))
    roughness: Channels = parameter(_share("√α of the specular lobe", 0.5, "roughness"))
    metallic: Channels = parameter(_share("share of metal", 0.0), default=0.0)
    specular: Channels = parameter(_share("reflectance at normal over 0.08", 0.5, "fresnel"), default=0.5)
    specular_tint: Channels = parameter(_share("tint of the lobe", 0.0), default=0.0)
    anisotropic: Channels = parameter(_share("aspect of the lobe", 0.0), default=0.0)
    sheen: Channels = parameter(_share("grazing sheen", 0.0), default=0.0)
    sheen_tint: Channels = parameter(_share("tint of the sheen", 0.5), default=0.5)
    clearcoat: Channels = parameter(_share("strength of the clearcoat", 0.0), default=0.0)
    clearcoat_gloss: Channels = parameter(_share("gloss of the clearcoat", 1.0), default=1.0)
    subsurface: Channels = parameter(_share("share of the flatter diffuser", 0.0), default=0.0)
    variant: str = eqx.field(static=True, default="disney", metadata={"choices": ("disney", "mitsuba")})

    @property
    def widths(self) -> tuple[Scalar, Scalar]:
        """(α_x, α_y) of the specular lobe."""
        aspect, alpha = jnp.sqrt(1.0 - 0.9 * self.anisotropic), self.roughness**2
        return jnp.maximum(alpha / aspect, LEAST_ALPHA), jnp.maximum(alpha * aspect, LEAST_ALPHA)

    @property
    def clearcoat_alpha(self) -> Scalar:
        """The width of the clearcoat's lobe."""
        return _mix(0.1, 0.001, self.clearcoat_gloss)

    @property
    def tint(self) -> Scalar:
        """The base colour over its luminance; 1 where it is black."""
        color = self.base_color
        if color.ndim == 0:
            return jnp.ones_like(color)
        weights = jnp.asarray(LUMINANCE[self.variant], color.dtype) if color.shape == (3,) else 1.0 / color.shape[0]
        luminance = jnp.sum(weights * color)
        reflects = luminance > 0
        return jnp.where(reflects, color / jnp.where(reflects, luminance, 1.0), 1.0)

    def _diffuse(self, wi: Direction, wo: Direction) -> Scalar:
        cos_d = half_angles(wi, wo).cos_d
        f_i, f_o, f_d = (schlick_weight(c) for c in (wi.z, wo.z, cos_d))
        flat = self.roughness * cos_d**2
        retro = (1.0 + (2.0 * flat - 0.5) * f_i) * (1.0 + (2.0 * flat - 0.5) * f_o)
        smooth = (1.0 + (flat - 1.0) * f_i) * (1.0 + (flat - 1.0) * f_o)
        flatter = 1.25 * (smooth * (1.0 / (wi.z + wo.z) - 0.5) + 0.5)
        diffuse = _mix(retro, flatter, self.subsurface) / jnp.pi * self.base_color
        sheen = f_d * self.sheen * _mix(1.0, self.tint, self.sheen_tint)
        return (1.0 - self.metallic) * (diffuse + sheen)

    def _fresnel(self, cos_d: Scalar) -> Scalar:
        weight = schlick_weight(cos_d)
        f0 = 0.08 * self.specular
        metal = _mix(self.base_color, 1.0, weight)
        tinted = _mix(f0 * _mix(1.0, self.tint, self.specular_tint), 1.0, weight)
        if self.variant == "mitsuba":
            reflects = f0 > 0
            eta = jnp.where(reflects, 2.0 / (1.0 - jnp.sqrt(jnp.where(reflects, f0, 0.04))) - 1.0, 1.0)
            plain = fresnel_dielectric(jnp.maximum(cos_d, 1e-12), eta)
            tinted = _mix(plain, _mix(f0 * self.tint, 1.0, weight), self.specular_tint)
        return _mix(tinted, metal, self.metallic)

    def _specular(self, wi: Direction, wo: Direction) -> Scalar:
        h, cos_d, _ = half_angles(wi, wo)
        masked = ggx_cos_over_g1(wi, *self.widths) * ggx_cos_over_g1(wo, *self.widths)
        return self._fresnel(cos_d) * ggx_d(h, *self.widths) * (0.25 / masked)

    def _clearcoat(self, wi: Direction, wo: Direction) -> Scalar:
        h, cos_d, _ = half_angles(wi, wo)
        smith = CLEARCOAT_SMITH
        masking = 0.25 / (ggx_cos_over_g1(wi, smith, smith) * ggx_cos_over_g1(wo, smith, smith))
        if self.variant == "mitsuba":
            masking = masking * 4.0 * wi.z * wo.z
        reflected = _mix(0.04, 1.0, schlick_weight(cos_d))
        return 0.25 * self.clearcoat * reflected * gtr1_d(h, self.clearcoat_alpha) * masking

    def terms(self) -> tuple[AbstractBRDF, ...]:
        return tuple(PrincipledTerm(self, term) for term in ("diffuse", "specular", "clearcoat"))

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self._diffuse(wi, wo) + self._specular(wi, wo) + self._clearcoat(wi, wo)

    @property
    def isotropic(self) -> bool:
        return known_equal(self.anisotropic, 0.0)
