"""A rough interface between two media: reflection and refraction by microfacets [Walter et al. 2007]."""

import abc
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

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
from gonio.models.fresnel import fresnel_dielectric, fresnel_dielectric_inside
from gonio.models.geometry.directions import dot, reflect
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import half_angles
from gonio.models.geometry.horizon import EVERYWHERE, TWO_SIDED, Hemispheres, same_side, turned_over
from gonio.models.microfacet import base as mf
from gonio.models.microfacet import distributions as slopes
from gonio.models.microfacet.beckmann import Beckmann
from gonio.models.microfacet.ggx import GGX
from gonio.models.microfacet.widths import LAST_SLOPE, along_axes
from gonio.models.special.log_beta import log_beta
from gonio.models.warps.refraction import refraction_ray

ETA = ParameterInfo(
    0.2, 5.0, "1", "refractive index behind the surface, relative to that in front", start=1.5, role="index", log=True
)
DISTRIBUTION = {"choices": ("ggx", "beckmann")}
SMITH = {"choices": ("correlated", "separable", "walter")}


class AbstractInterface(AbstractBRDF):
    """What reflection and refraction of an interface share: its facets, seen from the side of the light.

    A final class has the fields named here.
    """

    lobe = True

    alpha_x: eqx.AbstractVar[Channels]
    alpha_y: eqx.AbstractVar[Channels]
    eta: eqx.AbstractVar[Channels]
    distribution: eqx.AbstractVar[str]
    smith: eqx.AbstractVar[str]

    @property
    def facets(self) -> GGX | Beckmann:
        """The facets, of F = 1, as a model that reflects."""
        model = Beckmann if self.distribution == "beckmann" else GGX
        return model(alpha_x=self.alpha_x, alpha_y=self.alpha_y, smith=self.smith)

    @property
    def index(self) -> Scalar:
        """The index by which directions are refracted: the mean where channels differ, as geometry has no channels."""
        return jnp.mean(self.eta)

    @property
    def isotropic(self) -> bool:
        return self.facets.isotropic

    def cos_over_g1(self, w: Direction, alpha_x: Scalar, alpha_y: Scalar) -> Scalar:
        """w.z (1 + Λ(w)) for w.z ≥ 0."""
        if self.distribution == "ggx":
            return slopes.ggx_cos_over_g1(w, alpha_x, alpha_y)
        one = slopes.walter_cos_over_g1 if self.smith == "walter" else slopes.beckmann_cos_over_g1
        return one(w, alpha_x, alpha_y)

    def relative(self, wi: Direction) -> tuple[Scalar, Scalar, Scalar, Direction]:
        """(r, r² − 1, side, wi seen from its side), r the index at the light over that behind the surface from it."""
        eta, front = self.index, wi.z > 0
        excess = (eta - 1.0) * (eta + 1.0)
        side = jnp.where(front, 1.0, -1.0)
        ratio, ratio2_1 = jnp.where(front, 1.0 / eta, eta), jnp.where(front, -excess / eta**2, excess)
        return ratio, ratio2_1, side, turned_over(wi, side)

    def drawn_facet(self, wi: Direction, u1: Scalar, u2: Scalar) -> Direction:
        """A facet for light from wi above: one of GGX's visible ones, or one of all of Beckmann's."""
        if self.distribution == "ggx":
            return slopes.ggx_visible_normal(wi, *self.facets.mean_widths, u1, u2)
        return slopes.beckmann_normal(*self.facets.mean_widths, u1, u2)

    def facet_density(self, wi: Direction, m: Direction, cos_m: Scalar) -> Scalar:
        """Density of `drawn_facet`, 1/sr, at a facet with wi·m = cos_m > 0."""
        widths = self.facets.mean_widths
        if self.distribution == "ggx":
            return slopes.ggx_d(m, *widths) * cos_m / positive(slopes.ggx_cos_over_g1(wi, *widths))
        return slopes.beckmann_d(m, *widths) * m.z

    @abc.abstractmethod
    def masking(self, wi: Direction, wo: Direction) -> Scalar:
        """G₂(wi, wo)/(cosθi cosθo) of two directions above."""


class RoughReflection(AbstractInterface):
    """F D G₂/(4 cosθi cosθo), on either side."""

    alpha_x: Channels
    alpha_y: Channels
    eta: Channels
    distribution: str = eqx.field(static=True)
    smith: str = eqx.field(static=True)

    @property
    def hemispheres(self) -> Hemispheres:
        return TWO_SIDED

    def masking(self, wi: Direction, wo: Direction) -> Scalar:
        return 4.0 * self.facets.visibility(wi, wo)

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        front = wi.z > 0
        wi, wo = (turned_over(w, jnp.where(front, 1.0, -1.0)) for w in (wi, wo))
        h, cos_d, _ = half_angles(wi, wo)
        outside, inside = fresnel_dielectric(cos_d, self.eta), fresnel_dielectric_inside(cos_d, self.eta)
        return jnp.where(front, outside, inside) * (0.25 * self.facets.density(h) * self.masking(wi, wo))

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """wi mirrored in a drawn facet; lost where that leads through the surface."""
        side = jnp.where(wi.z > 0, 1.0, -1.0)
        wi = turned_over(wi, side)
        m = self.drawn_facet(wi, u1, u2)
        wo = reflect(wi, m)
        return turned_over(wo, side), (wo.z > 0) & (dot(wi, m) > 0)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        side = jnp.where(wi.z > 0, 1.0, -1.0)
        wi, wo = turned_over(wi, side), turned_over(wo, side)
        h, cos_d, _ = half_angles(wi, wo)
        facing = (wo.z > 0) & (cos_d > 0)
        cos_d = jnp.where(facing, cos_d, 1.0)
        return jnp.where(facing, self.facet_density(wi, h, cos_d) / (4.0 * cos_d), 0.0)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        side = jnp.where(wi.z > 0, 1.0, -1.0)
        wo, jacobian = self.facets.lobe_map(turned_over(wi, side), u1, u2)
        return turned_over(wo, side), jacobian


class Refraction(NamedTuple):
    """Between two directions on either side: whether a facet refracts one into the other, its normal (in front), the
    cosines on it in front and behind, and |n_i wi + n_o wo|², n = 1 in front."""

    refracts: Bool[Array, "..."]
    h: Direction
    cos_front: Scalar
    cos_behind: Scalar
    length2: Scalar


def refraction(wi: Direction, wo: Direction, eta: Scalar) -> Refraction:
    """The facet that refracts wi into wo [Walter 2007, eq. 16], for unit directions on opposite sides.

    n_i wi + n_o wo = (wi + wo) + (η − 1) w, w the direction behind; its products with the directions hold η − 1 and
    q = |wi + wo|² alone: no digit is lost as η → 1, and exchanging wi and wo changes no bit.
    """
    front = wi.z > 0
    excess = eta - 1.0
    sign = jnp.where(excess < 0, 1.0, -1.0)
    both = [a + b for a, b in zip(wi, wo, strict=True)]
    q = both[0] ** 2 + both[1] ** 2 + both[2] ** 2
    v = [s + excess * jnp.where(front, o, i) for s, i, o in zip(both, wi, wo, strict=True)]
    length2 = v[0] ** 2 + v[1] ** 2 + v[2] ** 2
    null = length2 <= 0
    inverse = sign / jnp.sqrt(jnp.where(null, 1.0, length2))
    h = Direction(*(c * inverse for c in v))
    cos_front, cos_behind = (0.5 * eta * q - excess) * inverse, -(0.5 * q + excess) * inverse
    refracts = ~null & (jnp.minimum(cos_front, cos_behind) > 0) & (h.z > 0)
    safe = (jnp.where(refracts, c, 1.0) for c in (cos_front, cos_behind, length2))
    h = Direction(*(jnp.where(refracts, c, n) for c, n in zip(h, (0.0, 0.0, 1.0), strict=True)))
    return Refraction(refracts, h, *safe)


class RoughRefraction(AbstractInterface):
    """f_t = |i·h||o·h| n_o² (1 − F) D G₂/(cosθi cosθo |n_i i + n_o o|²) [Walter 2007, eq. 21], from either side."""

    alpha_x: Channels
    alpha_y: Channels
    eta: Channels
    distribution: str = eqx.field(static=True)
    smith: str = eqx.field(static=True)

    @property
    def hemispheres(self) -> Hemispheres:
        return Hemispheres.TRANSMISSION

    @property
    def index_behind(self) -> Channels:
        return self.eta

    @property
    def kinked(self) -> bool:
        return True

    def masking(self, wi: Direction, wo: Direction) -> Scalar:
        """Uncorrelated, or B(1 + Λi, 1 + Λo) of heights that light passes from opposite sides [Dupuy et al. 2016]."""
        l_i, l_o = (self.cos_over_g1(w, self.alpha_x, self.alpha_y) for w in (wi, wo))
        if self.smith != "correlated":
            return 1.0 / (l_i * l_o)
        z_i, z_o = positive(wi.z), positive(wo.z)
        return jnp.exp(log_beta(l_i / z_i, l_o / z_o) - jnp.log(z_i) - jnp.log(z_o))

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        eta, front = self.eta, wi.z > 0
        refracts, h, c_f, c_b, length2 = refraction(wi, wo, eta)
        passed = 2.0 * eta * c_f * c_b * (1.0 / (c_f + eta * c_b) ** 2 + 1.0 / (eta * c_f + c_b) ** 2)
        wi, wo = (turned_over(w, jnp.where(w.z > 0, 1.0, -1.0)) for w in (wi, wo))
        spread = jnp.where(front, eta * eta, 1.0) * c_f * c_b / length2
        return jnp.where(refracts, passed * spread * self.facets.density(h) * self.masking(wi, wo), 0.0)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """wi refracted by a drawn facet; lost where that reflects all, or leads back."""
        ratio, ratio2_1, side, wi = self.relative(wi)
        m = self.drawn_facet(wi, u1, u2)
        wo, _, passes = _refracted(wi, m, ratio, ratio2_1)
        return turned_over(wo, side), passes & (wo.z < 0)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        apart = ~same_side(wi, wo)
        wi, wo = (
            Direction(*(jnp.where(apart, c, n) for c, n in zip(w, (0, 0, s), strict=True)))
            for w, s in ((wi, 1.0), (wo, -1.0))
        )
        front = wi.z > 0
        refracts, h, c_f, c_b, length2 = refraction(wi, wo, self.index)
        c_i, c_o = jnp.where(front, c_f, c_b), jnp.where(front, c_b, c_f)
        wi = turned_over(wi, jnp.where(front, 1.0, -1.0))
        spread = jnp.where(front, self.index**2, 1.0) * c_o / length2
        return jnp.where(apart & refracts, self.facet_density(wi, h, c_i) * spread, 0.0)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """Polar coordinates of the facet's slope, over what refracts (see `gonio.models.warps.refraction`)."""
        ratio, ratio2_1, side, wi = self.relative(wi)
        alpha_x, alpha_y = self.facets.mean_widths
        ray = refraction_ray(wi, u1, alpha_x, alpha_y, ratio2_1 / ratio**2)
        # The cosine of what is refracted has a root at the edge of total reflection.
        dense = ratio2_1 > 0
        t, t_rate = jnp.where(dense, u2 * (2.0 - u2), u2), jnp.where(dense, 2.0 * (1.0 - u2), 1.0)
        if self.distribution == "ggx":
            low, high = ray.low / (1.0 + ray.low), 1.0 - 1.0 / (1.0 + ray.high)
            v = low + (high - low) * t
            s, rate = v / (1.0 - v), (high - low) * t_rate / (1.0 - v) ** 2
        else:
            low, high = jnp.minimum(ray.low, LAST_SLOPE), jnp.minimum(ray.high, LAST_SLOPE)
            s, rate = low + (high - low) * t, (high - low) * t_rate
        m_z = 1.0 / jnp.sqrt(1.0 + s * s * (ray.slope_x**2 + ray.slope_y**2))
        m = Direction(s * ray.slope_x * m_z, s * ray.slope_y * m_z, m_z)
        wo, cos_t, passes = _refracted(wi, m, ratio, ratio2_1)
        gap = ratio2_1 / (ratio * dot(wi, m) + cos_t)
        area = gap**2 / cos_t * m_z**3 * alpha_x * alpha_y * s * rate * ray.azimuth_rate
        return turned_over(wo, side), jnp.where(passes, area, 0.0)


def _refracted(
    wi: Direction, m: Direction, ratio: Scalar, ratio2_1: Scalar
) -> tuple[Direction, Scalar, Bool[Array, ""]]:
    """(direction below, cosine on the facet there, whether it refracts) of wi above at a facet m; ratio = n_i/n_o."""
    cos_m = dot(wi, m)
    cos2_t = (ratio * cos_m) ** 2 - ratio2_1
    passes = (cos2_t > 0) & (cos_m > 0)
    cos_t = jnp.sqrt(jnp.where(passes, cos2_t, 1.0))
    gap = ratio2_1 / jnp.where(passes, ratio * cos_m + cos_t, 1.0)
    return Direction(*(gap * c - ratio * w for c, w in zip(m, wi, strict=True))), cos_t, passes


class RoughDielectric(AbstractComposite):
    """Microfacets that reflect and refract between a medium in front and one of relative index η behind [Walter 2007].

    `distribution`: "ggx" (the default) or "beckmann"; `smith`: "correlated" (height-correlated in reflection, B(1 + Λi,
    1 + Λo) in transmission [Dupuy et al. 2016]), "separable", or "walter" (Beckmann's rational fit, as renderers have
    it). `alpha`, or `alpha_x` with `alpha_y`. Light comes from either side; f_t/n² is reciprocal, n the index at the
    exit: radiance is compressed in the denser medium, and R + T ≤ 1. What bounces more than once is lost. At η = 1
    exactly light goes straight through, which no finite f holds: f is 0.
    """

    loses_energy = "What is refracted or reflected towards another facet is lost: 0.33 at 80° for α = 0.5, η = 1.5."

    eta: Channels = parameter(ETA)
    alpha: Channels | None = parameter(mf.ALPHA, default=None)
    alpha_x: Channels | None = parameter(mf.ALPHA_X, default=None)
    alpha_y: Channels | None = parameter(mf.ALPHA_Y, default=None)
    distribution: str = eqx.field(static=True, default="ggx", metadata=DISTRIBUTION)
    smith: str = eqx.field(static=True, default="correlated", metadata=SMITH)

    def __check_init__(self) -> None:
        if self.smith == "walter" and self.distribution != "beckmann":
            raise GonioError('smith="walter" is a fit to Beckmann\'s masking; give distribution="beckmann" with it')

    @property
    def hemispheres(self) -> Hemispheres:
        return EVERYWHERE

    @property
    def index_behind(self) -> Channels:
        return self.eta

    def _of(self, term: Callable[..., AbstractInterface], eta: Channels) -> AbstractInterface:
        alpha_x, alpha_y = along_axes(self, "alpha")
        return term(alpha_x, alpha_y, eta, self.distribution, self.smith)

    def terms(self) -> tuple[AbstractBRDF, ...]:
        """Reflection, and refraction: a term for each channel where their indices send light into other directions."""
        if jnp.ndim(self.eta) == 0:
            return self._of(RoughReflection, self.eta), self._of(RoughRefraction, self.eta)
        each = jnp.eye(self.eta.size, dtype=self.eta.dtype)
        refractions = (Scaled(one, self._of(RoughRefraction, eta)) for one, eta in zip(each, self.eta, strict=True))
        return self._of(RoughReflection, self.eta), *refractions

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        reflection, refraction = (self._of(term, self.eta) for term in (RoughReflection, RoughRefraction))
        return reflection.f(wi, wo) + refraction.f(wi, wo)
