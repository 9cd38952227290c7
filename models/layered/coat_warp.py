"""The hemisphere outside of a coat, mapped for what lies below: every peak of the base is where refraction puts it.

A map that does not know of a narrow lobe below steps over it at every order, and its bound says nothing of that: a base
with a peak needs a branch here, or `lobe`, by which its own map is refracted.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from gonio.models.brdf import AbstractBRDF, Direction, Scalar
from gonio.models.microfacet.retro import Retro, mirrored
from gonio.models.surface_scatter.shift_invariant import AbstractDiscLobe
from gonio.models.volume_scatter.hot_spot import AbstractHotSpot
from gonio.models.warps.hemisphere import rough_diffuser_map
from gonio.models.warps.retroreflection import hot_spot_map
from gonio.models.warps.slopes import facet_direction, slope_ray


def refracted(w: Direction, eta: Scalar) -> Direction:
    """The direction inside a medium of index η > 1 of a direction outside, both from the surface upwards."""
    x, y = w.x / eta, w.y / eta
    return Direction(x, y, jnp.sqrt((eta - 1.0) * (eta + 1.0) + w.z * w.z) / eta)


def refracted_outwards(w: Direction, eta: Scalar) -> tuple[Direction, Bool[Array, "..."]]:
    """The direction outside of a direction inside, and whether there is one: from above, and not totally reflected."""
    out2 = 1.0 - eta**2 * (w.x**2 + w.y**2)
    passes = (w.z > 0) & (out2 > 0)
    return Direction(eta * w.x, eta * w.y, jnp.sqrt(jnp.where(passes, out2, 1.0))), passes


def coated_map(base: AbstractBRDF, eta: Scalar, wi: Direction, u1: Scalar, u2: Scalar) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)), sr, outside, for one term of a base below an interface of index η."""
    inner = refracted(wi, eta)
    if isinstance(base, AbstractDiscLobe):  # direction cosines outside are η times those inside
        return base.disc_map(wi, u1, u2, base.drawn_core(inner)[0] * eta)
    if isinstance(base, AbstractHotSpot):  # what goes back inside goes back outside
        return hot_spot_map(wi, u1, u2, *base.hot_spot(inner))
    if isinstance(base, Retro):
        base, wi = base.surface, mirrored(wi)
    if base.facet_widths is not None:
        return _facet_map(base.facet_widths, eta, inner, wi, u1, u2)
    return _refracted_map(base, eta, inner, u1, u2) if base.lobe else rough_diffuser_map(wi, u1, u2)


def _facet_map(
    widths: tuple[Scalar, Scalar], eta: Scalar, inner: Direction, wi: Direction, u1: Scalar, u2: Scalar
) -> tuple[Direction, Scalar]:
    # The lobe is as much wider outside as refraction makes it; equal steps of the inverse hyperbolic sine suit any law.
    wider = eta * inner.z / jnp.maximum(wi.z, 0.2)
    widths = jnp.minimum(widths[0] * wider, 1.0), jnp.minimum(widths[1] * wider, 1.0)
    ray = slope_ray(wi, u1, *widths)
    span = jnp.arcsinh(ray.horizon)
    return facet_direction(wi, ray, jnp.sinh(span * u2), jnp.cosh(span * u2) * span, *widths)


def _refracted_map(
    base: AbstractBRDF, eta: Scalar, inner: Direction, u1: Scalar, u2: Scalar
) -> tuple[Direction, Scalar]:
    # What is trapped inside has no area: a kink, which the bound tells of, where the lobe reaches it.
    inside, area = base.lobe_map(inner, u1, u2)
    outside, passes = refracted_outwards(inside, eta)
    return outside, jnp.where(passes, area * eta**2 * inside.z / outside.z, 0.0)
