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
    Scalar,
    Scaled,
    parameter,
)
from gonio.models.layered.coat_warp import coated_map, refracted
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

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        series = tables.coat_series(self.alpha, self.eta)
        alpha = jnp.broadcast_to(self.alpha, series.shape[1:])
        passed = [1.0 - jnp.minimum(tables.tabulated("coat", series, w.z, alpha), 1.0) for w in (wi, wo)]
        base = self.base.formula(*(refracted(w, self.index) for w in (wi, wo)))
        return base * (passed[0] * passed[1] * (1.0 / self.index**2))

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Direction:
        """The base's sample, refracted outwards; what is trapped or below goes below the horizon, linearly in z."""
        sampled, eta = self.base.sample(refracted(wi, self.index), u1, u2), self.index
        inner = _trapped_below(eta)
        out2 = 1.0 - eta * eta * (sampled.x**2 + sampled.y**2)
        leaves = (sampled.z > 0) & (out2 > 0)
        down = jnp.clip((sampled.z - inner) / (1.0 + inner), -1.0, 0.0)
        side2 = sampled.x**2 + sampled.y**2
        turned = jnp.sqrt((1.0 - down) * (1.0 + down) / jnp.where(side2 > 0, side2, 1.0))
        stretch = jnp.where(leaves, eta, jnp.where(side2 > 0, turned, 0.0))
        z = jnp.where(leaves, jnp.sqrt(jnp.where(leaves, out2, 1.0)), down)
        return Direction(sampled.x * stretch, sampled.y * stretch, z)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        eta, inner = self.index, _trapped_below(self.index)
        up = wo.z > 0
        through = refracted(wo, eta)
        z = jnp.clip(jnp.where(up, 0.0, wo.z) * (1.0 + inner) + inner, -1.0, 1.0)
        side2 = wo.x**2 + wo.y**2
        turned = jnp.sqrt((1.0 - z) * (1.0 + z) / jnp.where(side2 > 0, side2, 1.0))
        below = Direction(wo.x * turned, wo.y * turned, z)
        inside = Direction(*(jnp.where(up, a, b) for a, b in zip(through, below, strict=True)))
        rate = jnp.where(up, wo.z / (eta * eta * through.z), 1.0 + inner)
        return self.base.pdf(refracted(wi, eta), inside) * rate

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


def _trapped_below(eta: Scalar) -> Scalar:
    # The cosine inside of the critical angle.
    return jnp.sqrt((eta - 1.0) * (eta + 1.0)) / eta


class Coat(AbstractComposite):
    """f = f_coat + T(μi) T(μo) f_base(i′, o′)/η²: a dielectric GGX interface over a base [Weidlich & Wilkie 2007].

    i′ and o′ are refracted by Snell's law at the mean surface; T(μ) = 1 − E(μ) with E the albedo of the coat alone, by
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

    @property
    def accuracy(self) -> float:
        return 1e-7 + self.base.accuracy

    @property
    def violates(self) -> Mapping[str, str]:
        return self.base.violates

    def terms(self) -> tuple[AbstractBRDF, ...]:
        under = tuple(UnderCoat(part, self.alpha, self.eta) for part in self.base.terms())
        return (GGX(alpha=self.alpha, eta=self.eta), *under)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        coat = GGX(alpha=self.alpha, eta=self.eta)
        return coat.formula(wi, wo) + UnderCoat(self.base, self.alpha, self.eta).formula(wi, wo)

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic
