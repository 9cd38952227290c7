"""A rough clear coat over any base."""

from collections.abc import Mapping
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
    Scaled,
    parameter,
)
from gonio.models.errors import GonioError
from gonio.models.geometry.horizon import Hemispheres
from gonio.models.layered.coat_warp import coated_map, refracted, refracted_outwards
from gonio.models.microfacet import albedo_tables as tables
from gonio.models.microfacet.ggx import GGX

ALPHA = ParameterInfo(1e-4, 1.0, "1", "width of the coat's slope distribution", start=0.1, role="width", log=True)
ETA = ParameterInfo(1.01, 4.0, "1", "refractive index of the coat", start=1.5, role="index", log=True)


class UnderCoat(AbstractBRDF):
    """f = T(μi) T(μo) f_base(i′, o′)/η²: the base as seen through a coat, T = 1 − E of the coat."""

    base: AbstractBRDF
    alpha: Channels
    eta: Channels

    @property
    def index(self) -> Scalar:
        """The index by which directions are refracted: the mean where channels differ, as geometry has no channels."""
        return jnp.mean(self.eta)

    def passed(self, w: Direction) -> Channels:
        """T(μ) of a direction."""
        series = tables.coat_series(self.alpha, self.eta)
        alpha = jnp.broadcast_to(self.alpha, series.shape[1:])
        return 1.0 - jnp.minimum(tables.tabulated("coat", series, w.z, alpha), 1.0)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        base = self.base.formula(*(refracted(w, self.index) for w in (wi, wo)))
        return base * (self.passed(wi) * self.passed(wo) * (1.0 / self.index**2))

    def mirror_reflectance(self, wi: Direction) -> Channels:
        """T(μi)² of what the base mirrors: the image leaves at the angle at which it came."""
        return self.base.mirror_reflectance(refracted(wi, self.index)) * self.passed(wi) ** 2

    @property
    def costly(self) -> bool:
        return self.base.costly

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """The base's sample, refracted outwards; what the interface reflects totally does not leave."""
        inside, leaves = self.base.sample(refracted(wi, self.index), u1, u2)
        outside, passes = refracted_outwards(inside, self.index)
        return outside, leaves & passes

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        up = wo.z > 0
        inside = refracted(wo, self.index)
        density = self.base.pdf(refracted(wi, self.index), inside) * (wo.z / (self.index**2 * inside.z))
        return jnp.where(up, density, 0.0)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """That of the base, over the directions outside; coats over one another refract as one."""
        base, eta = self.base, self.index
        while isinstance(base, Scaled | UnderCoat):
            eta = eta * base.index if isinstance(base, UnderCoat) else eta
            base = base.base
        return coated_map(base, eta, wi, u1, u2)

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic


class Coat(AbstractComposite):
    """f = f_coat + T(μi) T(μo) f_base(i′, o′)/η²: a dielectric GGX interface over a base [Weidlich & Wilkie 2007].

    i′ and o′ are refracted by Snell's law at the mean surface, as is the image of the source that a base mirrors beside
    its f, T(μi)² of which is left; T(μ) = 1 − E(μ) with E the albedo of the coat alone, by
    our own integrals. Reciprocal where the base is. It conserves energy whenever the base does: as η² μ′dω′ = μ dω,
    ∫ f μo dωo = E(μi) + T(μi) ∫ T(μo) f_base μ′o dω′o ≤ E(μi) + T(μi) = 1, the integral being over the directions that
    leave. `base` is a model or a sum of them; α in [1e-4, 1], η in [1.01, 4], isotropic, height-correlated masking.
    """

    loses_energy: ClassVar[str] = (
        "what the coat sends back into the base is lost: η = 1.5 over a white Lambertian base reflects 0.43 at normal"
    )

    base: AbstractBRDF = eqx.field(metadata={"model": True})
    alpha: Channels = parameter(ALPHA)
    eta: Channels = parameter(ETA)

    def __check_init__(self) -> None:
        if Hemispheres.TRANSMISSION in self.base.hemispheres:
            raise GonioError("the base of a coat transmits light; a coat stands over a surface that only reflects")

    @property
    def accuracy(self) -> float:
        return 1e-7 + self.base.accuracy

    @property
    def violates(self) -> Mapping[str, str]:
        return self.base.violates

    @property
    def symmetric(self) -> bool:
        return self.base.symmetric

    @property
    def validity_notes(self) -> tuple[str, ...]:
        return self.base.validity_notes

    def terms(self) -> tuple[AbstractBRDF, ...]:
        under = tuple(UnderCoat(part, self.alpha, self.eta) for part in self.base.terms())
        return (GGX(alpha=self.alpha, eta=self.eta), *under)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        coat = GGX(alpha=self.alpha, eta=self.eta)
        return coat.formula(wi, wo) + UnderCoat(self.base, self.alpha, self.eta).formula(wi, wo)

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic
