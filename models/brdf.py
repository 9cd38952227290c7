"""What every BRDF is, and the two ways to make one of others: the sum and the scaling."""

import abc
from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from gonio.models.geometry.directions import Direction
from gonio.models.parameters import ParameterInfo, known_equal, parameter
from gonio.models.warps.cosine_hemisphere import cosine_pdf, cosine_sample

Scalar = Float[Array, ""]
Channels = Float[Array, "*channel"]


class AbstractBRDF(eqx.Module):
    """A reflecting surface: a PyTree of physical parameters that answers `f(wi, wo)`.

    Methods take scalar directions (components of shape ``()``); axes are added with `jax.vmap` (see
    `gonio.models.evaluation`). Parameters may carry one channel axis; geometry never does.
    """

    lobe: ClassVar[bool] = False
    """Whether the model is a lobe without an albedo of its own, which a fit gives a free scale."""

    violates: ClassVar[Mapping[str, str]] = {}
    """The laws (energy, reciprocity, positivity) that the published formula breaks, and where: one sentence each."""

    loses_energy: ClassVar[str] = ""
    """Where the published formula loses energy without a reason: one sentence, or nothing."""

    @property
    def accuracy(self) -> float:
        """What a model claims for its tables: an error of f of at most accuracy · (1/sr + f); 0: right to rounding."""
        return 0.0

    @property
    def isotropic(self) -> bool:
        """Whether f is known to depend on the azimuths only by their difference; False where JAX traces the widths.

        To take an isotropic surface for another costs evaluations; the converse would be an error.
        """
        return all(
            known_equal(getattr(self, f"{name}_x", None), getattr(self, f"{name}_y", None)) for name in ("alpha", "n")
        )

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        """The widths along x and y of the slopes of facets that make a lobe about the mirror direction, or None.

        By these a coat maps the lobe of its base (see `gonio.models.layered.coat_warp`).
        """
        return None

    @abc.abstractmethod
    def f(self, wi: Direction, wo: Direction) -> Channels:
        """BRDF value, 1/sr, without the cosine factor; 0 where either direction is at or below the horizon."""

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Direction:
        """The outgoing direction that an importance sampler draws from (u1, u2) uniform in [0, 1)².

        It may fall below the horizon (f is 0 there). The default is the cosine-weighted hemisphere; what has no
        sampler at all raises NotImplementedError.
        """
        return cosine_sample(u1, u2)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        """Density, 1/sr, of the directions that `sample` draws, for a `wo` anywhere on the sphere."""
        return cosine_pdf(wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """A map of the unit square onto the outgoing hemisphere, and its Jacobian dω/(du1 du2), sr: for quadrature.

        f·cosθ·Jacobian is smooth inside each of the panels that `gonio.models.albedo` uses (u1 cut at the
        quarters, u2 at the half), whatever the width of the lobe; the square covers the whole hemisphere above the
        horizon, or all of it where the lobe is above 1e-16 of its integral.
        """
        wo = self.sample(wi, u1, u2)
        return wo, 1.0 / self.pdf(wi, wo)

    def terms(self) -> "tuple[AbstractBRDF, ...]":
        """The BRDFs that add up to this one and have a lobe map each; itself, for most."""
        return (self,)

    def __add__(self, other: "AbstractBRDF") -> "AbstractBRDF":
        if not isinstance(other, AbstractBRDF):
            return NotImplemented
        return Sum((*terms(self), *terms(other)))

    def __mul__(self, scale: Any) -> "AbstractBRDF":
        return Scaled(scale, self)

    def __rmul__(self, scale: Any) -> "AbstractBRDF":
        return Scaled(scale, self)


SCALE = ParameterInfo(0.0, 1e6, "1", "factor of a lobe", start=0.5, per_channel=True, linear=True)


class Scaled(AbstractBRDF):
    """scale · base, with one scale or one for each channel."""

    scale: Channels = parameter(SCALE)
    base: AbstractBRDF

    def f(self, wi, wo):
        return self.scale * self.base.f(wi, wo)

    def sample(self, wi, u1, u2):
        return self.base.sample(wi, u1, u2)

    def pdf(self, wi, wo):
        return self.base.pdf(wi, wo)

    def lobe_map(self, wi, u1, u2):
        return self.base.lobe_map(wi, u1, u2)

    def terms(self):
        return tuple(Scaled(self.scale, part) for part in self.base.terms())

    @property
    def accuracy(self):
        return float(jnp.max(jnp.maximum(self.scale, 1.0))) * self.base.accuracy if self.base.accuracy else 0.0

    @property
    def violates(self):
        return self.base.violates

    @property
    def loses_energy(self):
        return self.base.loses_energy

    @property
    def isotropic(self):
        return self.base.isotropic

    @property
    def facet_widths(self):
        return self.base.facet_widths


class Sum(AbstractBRDF):
    """The sum of several BRDFs. Its sampler draws from each with equal probability; integrals go term by term."""

    parts: tuple[AbstractBRDF, ...]

    def f(self, wi, wo):
        total = self.parts[0].f(wi, wo)
        for part in self.parts[1:]:
            total = total + part.f(wi, wo)
        return total

    def sample(self, wi, u1, u2):
        n = len(self.parts)
        which = jnp.minimum(jnp.floor(u1 * n), n - 1)
        drawn = [part.sample(wi, u1 * n - which, u2) for part in self.parts]
        return Direction(*(jnp.select([which == i for i in range(n)], list(c)) for c in zip(*drawn, strict=True)))

    def pdf(self, wi, wo):
        return sum(part.pdf(wi, wo) for part in self.parts) / len(self.parts)

    def lobe_map(self, wi, u1, u2):
        raise TypeError("a sum has no lobe map of its own: integrate each of terms() with its own")

    def terms(self):
        return tuple(s for part in self.parts for s in part.terms())

    @property
    def accuracy(self):
        return sum(part.accuracy for part in self.parts)

    @property
    def violates(self):
        return {law: how for part in reversed(self.parts) for law, how in part.violates.items()}

    @property
    def isotropic(self):
        return all(part.isotropic for part in self.parts)


class AbstractComposite(AbstractBRDF):
    """A model of several terms, `terms`, which have a lobe map each: it is drawn and integrated term by term."""

    @abc.abstractmethod
    def terms(self):
        """The terms that add up to the model."""

    def f(self, wi, wo):
        return Sum(self.terms()).f(wi, wo)

    def sample(self, wi, u1, u2):
        return Sum(self.terms()).sample(wi, u1, u2)

    def pdf(self, wi, wo):
        return Sum(self.terms()).pdf(wi, wo)

    def lobe_map(self, wi, u1, u2):
        return Sum(self.terms()).lobe_map(wi, u1, u2)


def terms(brdf: AbstractBRDF) -> tuple[AbstractBRDF, ...]:
    """The terms of a BRDF, sums opened and scalings multiplied into them; a single term for anything else."""
    if isinstance(brdf, Sum):
        return tuple(t for part in brdf.parts for t in terms(part))
    if isinstance(brdf, Scaled) and isinstance(brdf.base, Sum | Scaled):
        inner = terms(brdf.base)
        if len(inner) > 1 or isinstance(inner[0], Scaled):
            return tuple(
                Scaled(brdf.scale * t.scale, t.base) if isinstance(t, Scaled) else Scaled(brdf.scale, t) for t in inner
            )
    return (brdf,)
