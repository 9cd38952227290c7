"""The light that bounces between the facets more than once: what a single bounce is missing, given back."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from gonio.models.brdf import AbstractBRDF, Channels, Direction, Scalar, parameter
from gonio.models.errors import GonioError
from gonio.models.fresnel import fresnel_average, fresnel_of
from gonio.models.microfacet import albedo_tables as tables
from gonio.models.microfacet import base as mf
from gonio.models.warps.hemisphere import beside

ENERGY = {"choices": ("single", "kulla_conty", "turquin")}
ACCURACY = 2e-8
TURQUIN = (
    "the factor on the lobe depends on the direction of the light alone, so light and detector cannot change places"
)


def cosine_layer_map(
    cosines: tables.Cosines, alpha: Scalar, wi: Direction, u1: Scalar, u2: Scalar
) -> tuple[Direction, Scalar]:
    """Equal steps of azimuth from that of wi, and μ by the variable of a table: fine where μo is below α."""
    mu, rate = cosines.forward(u2, alpha)
    mu = jnp.clip(mu, 0.0, 1.0)
    return beside(wi, u1, jnp.sqrt((1.0 - mu) * (1.0 + mu)), mu), 2 * jnp.pi * rate


class MultipleBounces(AbstractBRDF):
    """f = F_ms (1 − E(μi))(1 − E(μo))/(π(1 − E_avg)) [Kulla & Conty 2017], E the albedo of F = 1 facets of the table.

    F_ms = F_avg² E_avg/(1 − F_avg(1 − E_avg)): what is left of the light that meets the facets twice or more.
    """

    alpha: Channels = parameter(mf.ALPHA)
    f0: Channels | None = parameter(mf.F0, default=None)
    eta: Channels | None = parameter(mf.ETA, default=None)
    k: Channels | None = parameter(mf.K, default=None)
    table: str = eqx.field(static=True, default="ggx_correlated")

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        series = tables.width_series(self.table, self.alpha)
        missing = tables.average(self.table, series, self.alpha)
        average = fresnel_average(self.f0, self.eta, self.k)
        colour = average**2 * (1.0 - missing) / (1.0 - average * missing)
        m_i, m_o = (tables.tabulated(self.table, series, w.z, self.alpha) for w in (wi, wo))
        return colour / missing * (m_i * m_o) / jnp.pi

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return cosine_layer_map(tables.KINDS[self.table].cosines, jnp.mean(self.alpha), wi, u1, u2)


class AbstractCompensated(mf.AbstractMicrofacet):
    """A microfacet model whose field `energy` says what becomes of the light that a single bounce does not reflect.

    "single": it is lost. "kulla_conty": given back as a broad term, reciprocal; F = 1 then reflects everything
    [Kulla & Conty 2017]. "turquin": the lobe is scaled by 1 + F₀(1 − E(μi))/E(μi), F₀ at normal incidence, E at the
    direction of the light, where the energy is counted [Turquin 2019]; not reciprocal. Isotropic widths only.
    """

    alpha: eqx.AbstractVar[Channels | None]
    f0: eqx.AbstractVar[Channels | None]
    eta: eqx.AbstractVar[Channels | None]
    k: eqx.AbstractVar[Channels | None]
    smith: eqx.AbstractVar[str]
    energy: eqx.AbstractVar[str]

    def __check_init__(self) -> None:
        if self.energy == "single":
            return
        if self.alpha is None:
            raise GonioError(
                f"energy={self.energy} knows isotropic surfaces only; give alpha instead of alpha_x, alpha_y."
            )
        if self.table not in tables.KINDS:
            raise GonioError(f"energy={self.energy} needs smith=correlated or separable, not {self.smith}.")

    @property
    def table(self) -> str:
        """The name of the albedo table of this distribution and masking."""
        return f"{type(self).__name__.lower()}_{self.smith}"

    @property
    def accuracy(self) -> float:
        return 0.0 if self.energy == "single" else ACCURACY

    @property
    def violates(self) -> Mapping[str, str]:
        return {"reciprocity": TURQUIN} if self.energy == "turquin" else {}

    @property
    def single(self) -> mf.AbstractMicrofacet:
        """The model of a single bounce."""
        return type(self)(alpha=self.alpha, f0=self.f0, eta=self.eta, k=self.k, smith=self.smith, energy="single")

    @property
    def bounces(self) -> MultipleBounces:
        """The term of two bounces and more [Kulla & Conty 2017]."""
        return MultipleBounces(alpha=self.widths[0], f0=self.f0, eta=self.eta, k=self.k, table=self.table)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        once = super().formula(wi, wo)
        if self.energy == "kulla_conty":
            return once + self.bounces.formula(wi, wo)
        if self.energy == "turquin":
            missing = tables.tabulated(self.table, tables.width_series(self.table, self.alpha), wi.z, self.alpha)
            normal = fresnel_of(self, jnp.ones_like(wi.z))
            return once * (1.0 + normal * (missing / (1.0 - missing)))
        return once

    def terms(self) -> tuple[AbstractBRDF, ...]:
        return (self.single, self.bounces) if self.energy == "kulla_conty" else (self,)
