"""Diffraction and scattering of light by a Gaussian rough surface."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import erfc

from gonio.models.brdf import Channels, Direction, ParameterInfo, Scalar, parameter
from gonio.models.fresnel import fresnel_of
from gonio.models.geometry.directions import add, dot
from gonio.models.microfacet.base import ETA, K
from gonio.models.surface_scatter.diffraction_series import lambert_w, wave_series
from gonio.models.surface_scatter.shift_invariant import AbstractDiscLobe
from gonio.models.warps.direction_cosines import projected_distance2
from gonio.models.warps.grazing_azimuth import polar_parts

SIGMA = ParameterInfo(1e-4, 20.0, "µm", "rms height of the surface", start=0.2, role="length", log=True)
TAU = ParameterInfo(0.05, 1e3, "µm", "autocorrelation length of the heights", start=3.0, role="length", log=True)
WAVELENGTH = ParameterInfo(0.05, 50.0, "µm", "wavelength of the light", start=0.55, role="wavelength", log=True)
ROOT_PI = 1.7724538509055159
FAR = 26.0  # erfc and exp(−x²) are 0 beyond


class HeTorrance(AbstractDiscLobe):
    """f = F G S D/(π cosθi cosθo): the directional-diffuse part, unpolarised [He, Torrance, Sillion & Greenberg 1991].

    `sigma`, `tau` and `wavelength` in µm; F by `eta` (and `k`), or 1. The image of the source (the specular part) and
    the uniform diffuse part are not in it. D is the series of eq. 78 with all its terms, at any roughness. `form`:
    "westin" (the default), eq. 25 with its lost factor exp(−(τ cotθ/2σ)²) and eq. 78 with v_xy times 2π/λ, as in
    Westin's program: the one whose rough limit is Beckmann's; "errata", the former alone; "1991", both as printed, read
    with unit vectors.
    G is |v|⁴/v_z², to which the paper's eq. 76 reduces, finite where its cross products are all 0.
    """

    lobe = True
    violates: ClassVar = {
        "energy": 'As printed ("1991", "errata") it gains about (2π/λ)², 158 for λ = 0.5 µm, as eq. 78 lacks a unit;'
        ' "westin" gains 1e-4 where the correlation is a few wavelengths long.'
    }
    reach = 60.0

    sigma: Channels = parameter(SIGMA)
    tau: Channels = parameter(TAU)
    wavelength: Channels = parameter(WAVELENGTH)
    eta: Channels | None = parameter(ETA, default=None)
    k: Channels | None = parameter(K, default=None)
    form: str = eqx.field(static=True, default="westin", metadata={"choices": ("1991", "errata", "westin")})

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        cos2_d = jnp.minimum(0.25 * dot(add(wi, wo), add(wi, wo)), 1.0)
        sin_i, sin_o = polar_parts(wi)[0], polar_parts(wo)[0]
        hidden_i, hidden_o = self._hidden(wi.z, sin_i), self._hidden(wo.z, sin_o)
        # Apparent roughness, eq. 80-83: σ²/(1 + x²) with x exp(x²/2) = (K_i + K_o)/√(8π), so x² = W of its square.
        slopes = (sin_i * hidden_i / wi.z + sin_o * hidden_o / wo.z) / (2.0 * 2.0**0.5 * ROOT_PI)
        turns = self.sigma / self.wavelength / jnp.sqrt(1.0 + lambert_w(2.0 * jnp.log(jnp.maximum(slopes, 1e-20))))
        g = (2 * jnp.pi * turns * (wi.z + wo.z)) ** 2
        b = 0.25 * projected_distance2(wi, wo) * self._inverse_length**2
        # G D with v_z² of the one cancelled by g of the other: finite at grazing.
        scattered = 16 * jnp.pi**3 * (cos2_d * turns * self.tau / self.wavelength) ** 2 * wave_series(g, b)
        shown = self._shown(wi.z, sin_i, hidden_i) * self._shown(wo.z, sin_o, hidden_o)
        some = cos2_d > 0
        cos_d = jnp.where(some, jnp.sqrt(jnp.where(some, cos2_d, 1.0)), 0.0)
        return fresnel_of(self, cos_d) * scattered * shown

    @property
    def _inverse_length(self) -> Scalar:
        # What makes v_xy of unit vectors the exponent's number.
        return 2 * jnp.pi * self.tau / self.wavelength if self.form == "westin" else self.tau

    def _cotangent(self, cos_t: Scalar, sin_t: Scalar) -> Scalar:
        # τ cotθ/(2σ), at most FAR.
        steep = 2.0 * self.sigma * sin_t
        shallow = steep * FAR <= self.tau * cos_t
        return jnp.where(shallow, FAR, self.tau * cos_t / jnp.where(shallow, 1.0, steep))

    def _hidden(self, cos_t: Scalar, sin_t: Scalar) -> Scalar:
        return erfc(self._cotangent(cos_t, sin_t))

    def _shown(self, cos_t: Scalar, sin_t: Scalar, hidden: Scalar) -> Scalar:
        """S₁/cosθ of eq. 24 and 25, finite at grazing; 1/cosθ where nothing hides."""
        lit = 1.0 - 0.5 * hidden
        cotangent = self._cotangent(cos_t, sin_t)
        lost = 1.0 if self.form == "1991" else jnp.exp(-cotangent * cotangent)
        return lit / (cos_t * lit + sin_t * lost * (self.sigma / self.tau / ROOT_PI))

    def core(self, wi: Direction) -> tuple[Channels, Channels]:
        # The first order's width, or that of the rough limit where many orders count.
        g = (4 * jnp.pi * self.sigma / self.wavelength * jnp.maximum(wi.z, 0.0)) ** 2
        return 2.0 * jnp.sqrt(1.0 + g) / self._inverse_length, jnp.ones_like(self.tau)
