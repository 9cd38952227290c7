"""The kernels of the MODIS albedo product."""

from typing import ClassVar

import jax
import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.geometry.guards import positive
from gonio.models.geometry.phase_angle import PhaseChords, phase_chords
from gonio.models.warps.retroreflection import back_direction, back_ray

ISOTROPIC = ParameterInfo(0.0, 2.0, "1", "weight of the constant 1", start=0.3, role="weight", per_channel=True)
VOLUMETRIC = ParameterInfo(0.0, 2.0, "1", "weight of the volumetric kernel", start=0.1, role="weight", per_channel=True)
GEOMETRIC = ParameterInfo(0.0, 2.0, "1", "weight of the geometric kernel", start=0.03, role="weight", per_channel=True)


class RossLi(AbstractBRDF):
    """f = (f_iso + f_vol K_vol + f_geo K_geo)/π: Ross-thick, Li-sparse-reciprocal [Lucht, Schaaf & Strahler 2000].

    K_vol is their eq. 38, of a dense canopy of leaves; K_geo their eq. 39 to 44, of crowns and their shadows, with
    h/b = 2 and b/r = 1. Both are 0 with light and detector at the zenith. The reflectance factor is π f.
    """

    violates: ClassVar = {
        "energy": "the weights are free, and K_vol has the albedo 1.57 at grazing",
        "positivity": "K_geo falls to −1/μ at grazing, off the hot spot, whatever the other weights",
    }

    f_iso: Channels = parameter(ISOTROPIC)
    f_vol: Channels = parameter(VOLUMETRIC)
    f_geo: Channels = parameter(GEOMETRIC)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        chords = phase_chords(wi, wo)
        mu_i, mu_o = positive(wi.z), positive(wo.z)
        volumetric, geometric = ross_thick(mu_i, mu_o, chords), li_sparse(mu_i, mu_o, chords)
        return (self.f_iso + self.f_vol * volumetric + self.f_geo * geometric) / jnp.pi

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """About wi; the shadows part at tan(g/2) = μi/(2 − sinθi cosψ), which is u2 = ½."""
        ray = back_ray(wi, u1)
        mu = jnp.maximum(wi.z, 1e-8)
        parting = 2.0 * jnp.arctan(mu / (2.0 - ray.rise))
        v, inner = 2.0 * u2, u2 < 0.5
        # The overlap ends as the power 3/2 of the distance from there: a square makes it smooth.
        # Beyond, 1/(μi + μo) has poles 4μi before the start and μi after the end: the logarithm of the ratio of the
        # distances from them in equal steps.
        length = ray.horizon - parting
        low, high = jnp.log(4.0 * mu / (length + mu)), jnp.log((length + 4.0 * mu) / mu)
        ratio = jnp.exp(low + (high - low) * (v - 1.0))
        beyond = (ratio * (length + mu) - 4.0 * mu) / (1.0 + ratio)
        g = jnp.where(inner, parting * (1.0 - (1.0 - v) ** 2), parting + beyond)
        beyond_rate = 2.0 * (high - low) * (length + 5.0 * mu) * ratio / (1.0 + ratio) ** 2
        rate = jnp.where(inner, parting * 4.0 * (1.0 - v), beyond_rate)
        return back_direction(wi, ray, g, rate)


def ross_thick(mu_i: Scalar, mu_o: Scalar, chords: PhaseChords) -> Scalar:
    """((π/2 − ξ) cos ξ + sin ξ)/(μi + μo) − π/4, ξ the phase angle [Lucht 2000, eq. 38]."""
    apart, together = chords
    xi = 2.0 * jnp.arctan2(apart, together)
    cos_xi, sin_xi = 0.25 * (together - apart) * (together + apart), 0.5 * apart * together
    return ((0.5 * jnp.pi - xi) * cos_xi + sin_xi) / (mu_i + mu_o) - 0.25 * jnp.pi


def li_sparse(mu_i: Scalar, mu_o: Scalar, chords: PhaseChords) -> Scalar:
    """O − sec θi − sec θo + ½(1 + cos ξ) sec θi sec θo, O the overlap of the shadows [Lucht 2000, eq. 39 to 44].

    D² + (tanθi tanθo sinφ)² there is |wi × wo|²/(μi μo)², so that cos t = (h/b) sin ξ/(μi + μo).
    """
    apart, together = chords
    cos_t = apart * together / (mu_i + mu_o)
    secants = (mu_i + mu_o) * (_overlap(cos_t) / jnp.pi - 1.0)
    return (secants + 0.25 * together**2) / (mu_i * mu_o)


@jax.custom_jvp
def _overlap(cos_t: Scalar) -> Scalar:
    # t − sin t cos t, 0 where cos t would exceed 1; its slope −2 sin t needs no inverse cosine.
    c = jnp.minimum(cos_t, 1.0)
    s = jnp.sqrt((1.0 - c) * (1.0 + c))
    return jnp.arctan2(s, c) - s * c


@_overlap.defjvp
def _overlap_jvp(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    c = jnp.minimum(primals[0], 1.0)
    return _overlap(primals[0]), -2.0 * jnp.sqrt((1.0 - c) * (1.0 + c)) * tangents[0]
