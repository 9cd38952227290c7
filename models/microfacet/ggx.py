"""The GGX (Trowbridge-Reitz) microfacet model."""

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import Channels, Direction, Sample, Scalar, parameter
from gonio.models.geometry.directions import half_vector, reflect
from gonio.models.geometry.guards import grazing_scale, positive
from gonio.models.microfacet import base as mf
from gonio.models.microfacet.distributions import ggx_cos_1_plus_2_lambda, ggx_cos_over_g1, ggx_d, ggx_visible_normal
from gonio.models.microfacet.energy_compensation import ENERGY, AbstractCompensated


class GGX(AbstractCompensated):
    """Microfacets with GGX slopes [Walter 2007, eq. 33] and Smith's masking [Heitz 2014, eq. 43 and 99].

    `smith`: "correlated" (height-correlated, the default) or "separable". `alpha`, or `alpha_x` with `alpha_y`.
    `energy`: "single" (the default), or what bounces more than once given back by "kulla_conty" or "turquin" (see
    `gonio.models.microfacet.energy_compensation`).
    """

    alpha: Channels | None = parameter(mf.ALPHA, default=None)
    alpha_x: Channels | None = parameter(mf.ALPHA_X, default=None)
    alpha_y: Channels | None = parameter(mf.ALPHA_Y, default=None)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)
    smith: str = eqx.field(static=True, default="correlated", metadata={"choices": ("correlated", "separable")})
    energy: str = eqx.field(static=True, default="single", metadata=ENERGY)

    def density(self, m: Direction) -> Channels:
        return ggx_d(m, *self.widths)

    def visibility(self, wi: Direction, wo: Direction) -> Channels:
        if self.smith == "separable":
            return 0.25 / (ggx_cos_over_g1(wi, *self.widths) * ggx_cos_over_g1(wo, *self.widths))
        s_i, s_o = ggx_cos_1_plus_2_lambda(wi, *self.widths), ggx_cos_1_plus_2_lambda(wo, *self.widths)
        z_i, z_o = positive(wi.z), positive(wo.z)
        # The square of the denominator, in the gradient, does not underflow then
        up = grazing_scale(jnp.result_type(z_i))
        return (0.5 * up) / ((z_o * s_i + z_i * s_o) * up)

    def slope_radius(self, u2: Scalar, horizon: Scalar) -> tuple[Scalar, Scalar]:
        # The tails fall as a power: the inverse hyperbolic sine gives core and tail their share.
        x_max = jnp.arcsinh(horizon)
        x = x_max * u2
        return jnp.sinh(x), jnp.cosh(x) * x_max

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        return reflect(wi, ggx_visible_normal(wi, *self.mean_widths, u1, u2)), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return 0.25 * ggx_d(half_vector(wi, wo), *self.mean_widths) / ggx_cos_over_g1(wi, *self.mean_widths)
