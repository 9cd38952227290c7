"""A rough clear coat over any base."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from gonio.models import albedo_table as tables
from gonio.models import microfacet as mf
from gonio.models.base import AbstractBRDF, Scalar, Scaled, Sum
from gonio.models.geometry import Direction
from gonio.models.ggx import GGX
from gonio.models.horizon import above
from gonio.models.oren_nayar import rough_diffuser_map
from gonio.models.parameters import ParameterInfo, parameter
from gonio.models.phong import Phong
from gonio.models.slope_map import facet_direction, slope_ray

ALPHA = ParameterInfo(1e-4, 1.0, "1", "width of the coat's slope distribution", start=0.1, log=True)
ETA = ParameterInfo(1.01, 4.0, "1", "refractive index of the coat", start=1.5, log=True)


def refracted(w: Direction, eta: Scalar) -> Direction:
    """The direction inside a medium of index η > 1 of a direction outside, both from the surface upwards."""
    x, y = w.x / eta, w.y / eta
    return Direction(x, y, jnp.sqrt((eta - 1.0) * (eta + 1.0) + w.z * w.z) / eta)


class UnderCoat(AbstractBRDF):
    """f = T(μi) T(μo) f_base(i′, o′)/η²: the base as seen through a coat, T = 1 − E of the coat."""

    base: AbstractBRDF
    alpha: Float[Array, "*channel"]
    eta: Float[Array, "*channel"]

    @property
    def index(self) -> Scalar:
        """The index by which directions are refracted: the mean where channels differ, as geometry has no channels."""
        return jnp.mean(self.eta)

    def f(self, wi, wo):
        both, wi, wo = above(wi, wo)
        series = tables.coat_series(self.alpha, self.eta)
        alpha = jnp.broadcast_to(self.alpha, series.shape[1:])
        passed = [1.0 - jnp.minimum(tables.tabulated("coat", series, w.z, alpha), 1.0) for w in (wi, wo)]
        base = self.base.f(*(refracted(w, self.index) for w in (wi, wo)))
        return jnp.where(both, passed[0] * passed[1] * base / self.index**2, 0.0)

    def sample(self, wi, u1, u2):
        """The base's sample, refracted outwards; what is trapped or below goes below the horizon, linearly in z."""
        drawn, eta = self.base.sample(refracted(wi, self.index), u1, u2), self.index
        inner = _trapped_below(eta)
        out2 = 1.0 - eta * eta * (drawn.x**2 + drawn.y**2)
        leaves = (drawn.z > 0) & (out2 > 0)
        down = jnp.clip((drawn.z - inner) / (1.0 + inner), -1.0, 0.0)
        side2 = drawn.x**2 + drawn.y**2
        turned = jnp.sqrt((1.0 - down) * (1.0 + down) / jnp.where(side2 > 0, side2, 1.0))
        stretch = jnp.where(leaves, eta, jnp.where(side2 > 0, turned, 0.0))
        z = jnp.where(leaves, jnp.sqrt(jnp.where(leaves, out2, 1.0)), down)
        return Direction(drawn.x * stretch, drawn.y * stretch, z)

    def pdf(self, wi, wo):
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

    def lobe_map(self, wi, u1, u2):
        """That of the base, over the directions outside: a facet's lobe is as much wider as refraction makes it."""
        base = self.base.base if isinstance(self.base, Scaled) else self.base
        widths = _facet_widths(base)
        if widths is not None:
            inner = refracted(wi, self.index)
            wider = self.index * inner.z / jnp.maximum(wi.z, 0.2)
            widths = [jnp.minimum(a * wider, 1.0) for a in widths]
            ray = slope_ray(wi, u1, *widths)
            span = jnp.arcsinh(ray.horizon)
            return facet_direction(wi, ray, jnp.sinh(span * u2), jnp.cosh(span * u2) * span, *widths)
        if base.lobe:
            inside, area = self.base.lobe_map(refracted(wi, self.index), u1, u2)
            out2 = 1.0 - self.index**2 * (inside.x**2 + inside.y**2)
            leaves = (inside.z > 0) & (out2 > 0)
            z = jnp.sqrt(jnp.where(leaves, out2, 1.0))
            rate = self.index**2 * inside.z / z
            out = Direction(self.index * inside.x, self.index * inside.y, z)
            return out, jnp.where(leaves, area * rate, 0.0)
        return rough_diffuser_map(wi, u1, u2)

    @property
    def isotropic(self):
        return self.base.isotropic


def _facet_widths(base: AbstractBRDF) -> tuple[Scalar, Scalar] | None:
    # The widths of the slopes, outside, that a lobe about the mirror direction takes; None for other models.
    if isinstance(base, mf.AbstractMicrofacet):
        return base.mean_widths
    if isinstance(base, Phong):
        alpha = jnp.sqrt(1.0 / (base.mean_n + 2.0))
        return alpha, alpha
    return None


def _trapped_below(eta: Scalar) -> Scalar:
    # The cosine inside of the critical angle.
    return jnp.sqrt((eta - 1.0) * (eta + 1.0)) / eta


class Coat(AbstractBRDF):
    """f = f_coat + T(μi) T(μo) f_base(i′, o′)/η²: a dielectric GGX interface over a base [Weidlich & Wilkie 2007].

    i′ and o′ are refracted by Snell's law at the mean surface; T(μ) = 1 − E(μ) with E the albedo of the coat alone, by
    our own integrals. Reciprocal where the base is. It conserves energy whenever the base does: as η² μ′dω′ = μ dω,
    ∫ f μo dωo = E(μi) + T(μi) ∫ T(μo) f_base μ′o dω′o ≤ E(μi) + T(μi) = 1, the integral being over the directions that
    leave. `base` is a model or a sum of them; α in [1e-4, 1], η in [1.01, 4], isotropic, height-correlated masking.
    """

    loses: ClassVar[str] = (
        "what the coat sends back into the base is lost: η = 1.5 over a white Lambertian base reflects 0.43 at normal"
    )

    base: AbstractBRDF = eqx.field(metadata={"model": True})
    alpha: Float[Array, "*channel"] = parameter(ALPHA)
    eta: Float[Array, "*channel"] = parameter(ETA)

    @property
    def accuracy(self):
        return 1e-7

    def summands(self):
        under = tuple(UnderCoat(part, self.alpha, self.eta) for part in self.base.summands())
        return (GGX(alpha=self.alpha, eta=self.eta), *under)

    def f(self, wi, wo):
        return GGX(alpha=self.alpha, eta=self.eta).f(wi, wo) + UnderCoat(self.base, self.alpha, self.eta).f(wi, wo)

    def sample(self, wi, u1, u2):
        return Sum(self.summands()).sample(wi, u1, u2)

    def pdf(self, wi, wo):
        return Sum(self.summands()).pdf(wi, wo)

    def lobe_map(self, wi, u1, u2):
        return Sum(self.summands()).lobe_map(wi, u1, u2)

    @property
    def isotropic(self):
        return self.base.isotropic
