"""What every BRDF is, and the two ways to make one of others: the sum and the scaling.

What the file of a model needs has this one address, the types of its fields and arguments included.
"""

import abc
import functools
import operator
from collections.abc import Mapping
from typing import Any, ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from gonio.models.arrays import Channels, Scalar
from gonio.models.errors import GonioError
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.horizon import Hemispheres, guarded_pair, lit
from gonio.models.parameters import ParameterInfo, known_equal, known_total_reflection, parameter
from gonio.models.warps.hemisphere import cosine_pdf, cosine_sample

Sample = tuple[Direction, Bool[Array, ""] | bool]
"""A direction that an importance sampler draws, and whether the light leaves the surface along it: if not, it is lost
inside, as by total reflection below a coat, and the direction means nothing."""


class AbstractBRDF(eqx.Module):
    """A surface that reflects or transmits: a PyTree of physical parameters that answers `f(wi, wo)`.

    A model implements `formula`, and declares the hemispheres that it scatters into; `f` guards the horizon for all.

    Methods take scalar directions (components of shape ``()``); axes are added with `jax.vmap` (see
    `gonio.models.evaluation`). Parameters may carry one channel axis; geometry never does.
    """

    lobe: ClassVar[bool] = False
    """Whether the model is a lobe without an albedo of its own, which a fit gives a free scale."""

    prepared: ClassVar[bool] = False
    """Whether much of the formula depends on parameters alone: a fit then computes that apart, once for each step."""

    violates: ClassVar[Mapping[str, str]] = {}
    """The laws (energy, reciprocity, positivity) that the published formula breaks, and where: one sentence each."""

    loses_energy: ClassVar[str] = ""
    """Where the published formula loses energy without a reason: one sentence, or nothing."""

    @property
    def hemispheres(self) -> Hemispheres:
        """The hemispheres that the surface scatters into; by default light of the front, back into it."""
        return Hemispheres.REFLECTION

    @property
    def index_behind(self) -> Channels | float:
        """Refractive index behind the surface relative to that in front; 1 for a sheet in one medium.

        Of an interface, f over the square of the index on the side of the exit is reciprocal.
        """
        return 1.0

    @property
    def accuracy(self) -> float:
        """What a model claims for its tables: an error of f of at most accuracy · (1/sr + f); 0: right to rounding."""
        return 0.0

    @property
    def costly(self) -> bool:
        """Whether f costs tens of microfacet lobes: integrals then begin finer, and take no more than is needed."""
        return False

    @property
    def kinked(self) -> bool:
        """Whether the lobe map leaves kinks inside its panels: rules of higher order then gain a fixed factor alone."""
        return False

    @property
    def totally_reflects(self) -> bool:
        """Whether light is reflected totally from some angle on, as beyond an index below 1 that hardly absorbs.

        Two orders may agree by accident there: the slope of f is infinite at that angle.
        """
        return known_total_reflection(getattr(self, "eta", None), getattr(self, "k", None))

    @property
    def isotropic(self) -> bool:
        """Whether f is known to depend on the azimuths only by their difference; False where JAX traces the widths.

        To take an isotropic surface for another costs evaluations; the converse would be an error.
        """
        return all(
            known_equal(getattr(self, f"{name}_x", None), getattr(self, f"{name}_y", None)) for name in ("alpha", "n")
        )

    @property
    def symmetric(self) -> bool:
        """Whether f stays as it is where both directions are mirrored at the plane of x and the normal."""
        return True

    @property
    def validity_notes(self) -> tuple[str, ...]:
        """Where the parameters leave the range that the model's approximation is made for: a sentence each."""
        return ()

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        """The widths along x and y of the slopes of facets that make a lobe about the mirror direction, or None.

        By these a coat maps the lobe of its base (see `gonio.models.layered.coat_warp`).
        """
        return None

    @final
    def f(self, wi: Direction, wo: Direction) -> Channels:
        """BRDF or BTDF value dL/dE, 1/sr, without the cosine factor; 0 outside of the hemispheres of the model.

        Raises:
            GonioError: the directions have an axis that would mix with the channels of the parameters.
        """
        _refuse_mixed_axes(self, wi, wo)
        mask, wi, wo = guarded_pair(self.hemispheres, wi, wo)
        return jnp.where(mask, self.formula(wi, wo), 0.0)

    @abc.abstractmethod
    def formula(self, wi: Direction, wo: Direction) -> Channels:
        """The bare formula of f, 1/sr, for two directions of the declared hemispheres, neither on the horizon."""

    def array_values(self, wi: Direction, wo: Direction) -> np.ndarray | None:
        """`f` of many pairs by NumPy, for a model that looks it up: to compile that for each size takes longer.

        Args:
            wi, wo: unit directions with components of shape (n,), NumPy.

        Returns:
            f, 1/sr, of shape (n, channels); None for a model that is a formula.
        """
        return None

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        """(wo, leaves): the direction that an importance sampler draws from (u1, u2) uniform in [0, 1)².

        `leaves` is whether the light leaves the surface along it. wo may fall outside of the hemispheres that the model
        declares (f is 0 there). The default is the cosine-weighted hemisphere; what has no sampler at all raises
        NotImplementedError.
        """
        return cosine_sample(u1, u2), True

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        """Density, 1/sr, of the directions that `sample` draws, for a `wo` anywhere on the sphere.

        Its integral is the share of what is drawn that leaves: 1 where nothing is lost inside.
        """
        return cosine_pdf(wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        """A map of the unit square onto the outgoing hemisphere, and its Jacobian dω/(du1 du2), sr: for quadrature.

        f·cosθ·Jacobian is smooth inside each of the panels that `gonio.models.albedo` uses (u1 cut at the
        quarters, u2 at the half), whatever the width of the lobe; the square covers the whole hemisphere above the
        horizon, or all of it where the lobe is above 1e-16 of its integral.
        """
        wo, leaves = self.sample(wi, u1, u2)
        return wo, jnp.where(leaves, 1.0 / jnp.where(leaves, self.pdf(wi, wo), 1.0), 0.0)

    def flux(self, wi: Direction, u1: Scalar, u2: Scalar, side: Scalar) -> Channels:
        """f |cosθo| dω/(du1 du2) at a point of the lobe map: what integrates to the share that leaves.

        `side` is 1 for what leaves in front, -1 for what leaves behind.
        """
        wo, jacobian = self.lobe_map(wi, u1, u2)
        return self.f(wi, wo) * (jnp.maximum(side * wo.z, 0.0) * jacobian)

    def mirror_reflectance(self, wi: Direction) -> Channels:
        """Share of the light from `wi` that leaves as an image of its source: a delta, which is no part of f."""
        return jnp.zeros_like(wi.z)

    def terms(self) -> "tuple[AbstractBRDF, ...]":
        """The BRDFs that add up to this one and have a lobe map each; itself, for most."""
        return (self,)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "f" in vars(cls):
            raise TypeError(f"{cls.__name__} defines f, which guards the horizon for all: define formula instead")

    def __add__(self, other: "AbstractBRDF") -> "AbstractBRDF":
        if not isinstance(other, AbstractBRDF):
            return NotImplemented
        return Sum((*terms(self), *terms(other)))

    def __mul__(self, scale: Any) -> "AbstractBRDF":
        return Scaled(scale, self)

    def __rmul__(self, scale: Any) -> "AbstractBRDF":
        return Scaled(scale, self)


def _refuse_mixed_axes(brdf: AbstractBRDF, wi: Direction, wo: Direction) -> None:
    """Shapes are static, so nothing of this is left in a compiled program."""
    shape = jnp.broadcast_shapes(*(jnp.shape(c) for c in (*wi, *wo)))
    if shape[-1:] in ((), (1,)):
        return
    channels = max((jnp.shape(leaf)[-1] for leaf in jax.tree.leaves(brdf) if jnp.ndim(leaf)), default=1)
    if channels != 1:
        raise GonioError(
            f"f takes one pair of directions where parameters have channels: directions of shape {shape} would mix "
            f"with {channels} channels. Use gonio.models.evaluate(brdf, wi, wo), or Material.f."
        )


SCALE = ParameterInfo(0.0, 1e6, "1", "factor of a lobe", start=0.5, role="scale", per_channel=True, linear=True)


class Scaled(AbstractBRDF):
    """scale · base, with one scale or one for each channel."""

    scale: Channels = parameter(SCALE)
    base: AbstractBRDF  # pyright: ignore[reportGeneralTypeIssues]  # it takes `parameter` for a default

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return self.scale * self.base.formula(wi, wo)

    @property
    def hemispheres(self) -> Hemispheres:
        return self.base.hemispheres

    @property
    def index_behind(self) -> Channels | float:
        return self.base.index_behind

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        return self.base.sample(wi, u1, u2)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return self.base.pdf(wi, wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return self.base.lobe_map(wi, u1, u2)

    def flux(self, wi: Direction, u1: Scalar, u2: Scalar, side: Scalar) -> Channels:
        return self.scale * self.base.flux(wi, u1, u2, side)

    def mirror_reflectance(self, wi: Direction) -> Channels:
        return self.scale * self.base.mirror_reflectance(wi)

    def terms(self) -> tuple[AbstractBRDF, ...]:
        return tuple(Scaled(self.scale, part) for part in self.base.terms())

    @property
    def accuracy(self) -> float:
        return float(jnp.max(jnp.maximum(self.scale, 1.0))) * self.base.accuracy if self.base.accuracy else 0.0

    @property
    def violates(self) -> Mapping[str, str]:
        return self.base.violates

    @property
    def loses_energy(self) -> str:
        return self.base.loses_energy

    @property
    def costly(self) -> bool:
        return self.base.costly

    @property
    def kinked(self) -> bool:
        return self.base.kinked

    @property
    def totally_reflects(self) -> bool:
        return self.base.totally_reflects

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic

    @property
    def symmetric(self) -> bool:
        return self.base.symmetric

    @property
    def validity_notes(self) -> tuple[str, ...]:
        return self.base.validity_notes

    @property
    def facet_widths(self) -> tuple[Scalar, Scalar] | None:
        return self.base.facet_widths


class Sum(AbstractBRDF):
    """The sum of several BRDFs. Its sampler draws from each with equal probability; integrals go term by term."""

    parts: tuple[AbstractBRDF, ...]

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        values = [(p.formula if p.hemispheres == self.hemispheres else p.f)(wi, wo) for p in self.parts]
        return functools.reduce(operator.add, values)

    @property
    def hemispheres(self) -> Hemispheres:
        return functools.reduce(operator.or_, (p.hemispheres for p in self.parts))

    @property
    def index_behind(self) -> Channels | float:
        """That of the first part that has an interface between two media."""
        return next((p.index_behind for p in self.parts if not known_equal(p.index_behind, 1.0)), 1.0)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        n = len(self.parts)
        which = jnp.minimum(jnp.floor(u1 * n), n - 1)
        samples = [self._sample_of(part, wi, u1 * n - which, u2) for part in self.parts]
        chosen = [which == i for i in range(n)]
        directions, leaves = zip(*samples, strict=True)
        wo = Direction(*(jnp.select(chosen, list(c)) for c in zip(*directions, strict=True)))
        return wo, jnp.select(chosen, list(leaves), default=False)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return sum(self._pdf_of(part, wi, wo) for part in self.parts) / len(self.parts)

    def _sample_of(self, part: AbstractBRDF, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        # A part that only reflects loses what comes from behind.
        if part.hemispheres == self.hemispheres:
            return part.sample(wi, u1, u2)
        front, wi = lit(part.hemispheres, wi)
        wo, leaves = part.sample(wi, u1, u2)
        return wo, leaves & front

    def _pdf_of(self, part: AbstractBRDF, wi: Direction, wo: Direction) -> Scalar:
        if part.hemispheres == self.hemispheres:
            return part.pdf(wi, wo)
        front, wi = lit(part.hemispheres, wi)
        return jnp.where(front, part.pdf(wi, wo), 0.0)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        raise TypeError("a sum has no lobe map of its own: integrate each of terms() with its own")

    def mirror_reflectance(self, wi: Direction) -> Channels:
        return functools.reduce(operator.add, (part.mirror_reflectance(wi) for part in self.parts))

    def terms(self) -> tuple[AbstractBRDF, ...]:
        return tuple(s for part in self.parts for s in part.terms())

    @property
    def accuracy(self) -> float:
        return sum(part.accuracy for part in self.parts)

    @property
    def violates(self) -> Mapping[str, str]:
        return {law: how for part in reversed(self.parts) for law, how in part.violates.items()}

    @property
    def isotropic(self) -> bool:
        return all(part.isotropic for part in self.parts)

    @property
    def symmetric(self) -> bool:
        return all(part.symmetric for part in self.parts)

    @property
    def validity_notes(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(note for part in self.parts for note in part.validity_notes))


class AbstractComposite(AbstractBRDF):
    """A model of several terms, `terms`, which have a lobe map each: it is drawn and integrated term by term."""

    @abc.abstractmethod
    def terms(self) -> tuple[AbstractBRDF, ...]:
        """The terms that add up to the model."""

    def formula(self, wi: Direction, wo: Direction) -> Channels:
        return Sum(self.terms()).formula(wi, wo)

    def sample(self, wi: Direction, u1: Scalar, u2: Scalar) -> Sample:
        return Sum(self.terms()).sample(wi, u1, u2)

    def pdf(self, wi: Direction, wo: Direction) -> Scalar:
        return Sum(self.terms()).pdf(wi, wo)

    def lobe_map(self, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
        return Sum(self.terms()).lobe_map(wi, u1, u2)

    def mirror_reflectance(self, wi: Direction) -> Channels:
        return Sum(self.terms()).mirror_reflectance(wi)


def terms(brdf: AbstractBRDF) -> tuple[AbstractBRDF, ...]:
    """The terms of a BRDF, sums opened and scalings multiplied into them; a single term for anything else."""
    if isinstance(brdf, Sum):
        return tuple(t for part in brdf.parts for t in terms(part))
    if isinstance(brdf, Scaled) and isinstance(brdf.base, Sum | Scaled):
        inner = terms(brdf.base)
        if len(inner) > 1 or any(isinstance(t, Scaled) for t in inner):
            return tuple(
                Scaled(brdf.scale * t.scale, t.base) if isinstance(t, Scaled) else Scaled(brdf.scale, t) for t in inner
            )
    return (brdf,)


def changed_terms(a: AbstractBRDF, b: AbstractBRDF) -> tuple[AbstractBRDF, AbstractBRDF]:
    """The terms that two models of one structure do not share, as two models with the same difference.

    What is linear in f, such as an albedo, changes from one to the other by these terms alone.
    """
    terms_a, terms_b = a.terms(), b.terms()
    if len(terms_a) != len(terms_b):
        return a, b
    changed = [k for k, pair in enumerate(zip(terms_a, terms_b, strict=True)) if not _same(*pair)]
    if not changed or len(changed) == len(terms_a):
        return a, b
    return Sum(tuple(terms_a[k] for k in changed)), Sum(tuple(terms_b[k] for k in changed))


def _same(a: AbstractBRDF, b: AbstractBRDF) -> bool:
    (leaves_a, tree_a), (leaves_b, tree_b) = jax.tree_util.tree_flatten(a), jax.tree_util.tree_flatten(b)
    return tree_a == tree_b and all(np.array_equal(x, y) for x, y in zip(leaves_a, leaves_b, strict=True))
