"""The Beckmann microfacet model."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import Channels, Direction, parameter
from gonio.models.geometry.guards import grazing_scale, positive
from gonio.models.microfacet import base as mf
from gonio.models.microfacet import distributions as slopes
from gonio.models.microfacet.energy_compensation import ENERGY, AbstractCompensated
from gonio.models.microfacet.widths import AbstractGaussianFacets

UNSHADOWED = (
    'with smith="none" every facet is seen in full, and near grazing more of them than the surface has area: for '
    "α = 0.3 and F = 1 the albedo is 1.10 at 80° and 2.95 at 88°"
)


class Beckmann(AbstractCompensated, AbstractGaussianFacets):
    """Microfacets with Gaussian slopes [Beckmann & Spizzichino 1963; Walter 2007, eq. 25], Smith's masking.

    `smith`: "correlated" (the default), "separable" (both with the exact erf form), "walter" (separable, with the
    rational fit that renderers use), or "none" (G = 1: no facet hides or shadows another). `alpha`, or `alpha_x` with
    `alpha_y`. `energy`: "single" (the default), or what bounces more than once given back by "kulla_conty" or
    "turquin" (see `gonio.models.microfacet.energy_compensation`).
    """

    alpha: Channels | None = parameter(mf.ALPHA, default=None)
    alpha_x: Channels | None = parameter(mf.ALPHA_X, default=None)
    alpha_y: Channels | None = parameter(mf.ALPHA_Y, default=None)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)
    smith: str = eqx.field(
        static=True, default="correlated", metadata={"choices": ("correlated", "separable", "walter", "none")}
    )
    energy: str = eqx.field(static=True, default="single", metadata=ENERGY)

    @property
    def violates(self) -> Mapping[str, str]:
        return {**super().violates, **({"energy": UNSHADOWED} if self.smith == "none" else {})}

    def density(self, m: Direction) -> Channels:
        return slopes.beckmann_d(m, *self.widths)

    def visibility(self, wi: Direction, wo: Direction) -> Channels:
        if self.smith == "correlated":
            m_i, m_o = (slopes.beckmann_cos_lambda(w, *self.widths) for w in (wi, wo))
            z_i, z_o = positive(wi.z), positive(wo.z)
            # The square of the denominator, in the gradient, does not underflow then
            up = grazing_scale(jnp.result_type(z_i))
            return (0.25 * up) / ((z_i * z_o + z_o * m_i + z_i * m_o) * up)
        if self.smith == "none":
            return 0.25 * (1.0 / positive(wi.z)) * (1.0 / positive(wo.z))
        one = slopes.walter_cos_over_g1 if self.smith == "walter" else slopes.beckmann_cos_over_g1
        return 0.25 / (one(wi, *self.widths) * one(wo, *self.widths))
