"""Masking and shadowing by V-shaped cavities [Torrance & Sparrow 1967], and a map of the hemisphere with its kinks.

G = min(1, 2cosθ_h cosθi/cosθ_d, 2cosθ_h cosθo/cosθ_d) has three kinks. With the slope of the facet in polar coordinates
(`gonio.models.warps.slopes`: s in units of the width α, t the lean, ρ = α) they lie at
- ts = 1, where the first kink of cosθi is, and s = t/ρ², where cosθo = cosθi, on rays with t > ρ;
- s = tan(x)/ρ, tan 3x = −ρ/t, the kink of cosθo, on rays with t ≤ ρ (a cubic in ρs with one root above the horizon).
"""

import jax.numpy as jnp

from gonio.models.brdf import Direction, Scalar
from gonio.models.geometry.guards import positive
from gonio.models.geometry.half_vector import HalfAngles
from gonio.models.warps.grazing_azimuth import grazing_tangent
from gonio.models.warps.radial_laws import Law
from gonio.models.warps.slopes import facet_direction, slope_ray

SEAM = 0.881373587019543  # asinh(1): t = ρ, in the variable that the azimuth is clustered by


def v_cavity_visibility(wi: Direction, wo: Direction, half: HalfAngles) -> Scalar:
    """G/(cosθi cosθo), for directions above the horizon."""
    lower, higher = positive(jnp.minimum(wi.z, wo.z)), positive(jnp.maximum(wi.z, wo.z))
    cos_d = positive(half.cos_d)
    shadowed = 2.0 * half.h.z * lower < cos_d
    return jnp.where(shadowed, 2.0 * half.h.z * (1.0 / cos_d), 1.0 / lower) * (1.0 / higher)


def v_cavity_map(
    wi: Direction, u1: Scalar, u2: Scalar, alpha: Scalar, last: Scalar, law: Law
) -> tuple[Direction, Scalar]:
    """(wo, dω/(du1 du2)) with every kink of G on an edge of the panels that `gonio.models.albedo` uses.

    `law(v, low, high)` is a slope in units of α between two others, for v in [0, 1], and its derivative by v; slopes
    beyond `last` are left out. u1 < ½ are the rays with t < ρ, cut at the kink of cosθo; u1 in [½, ¾] those with t > ρ
    up to cosθo = cosθi, cut at ts = 1; u1 in [¾, 1] the same rays beyond.
    """
    # Rays turn with 2πu1' of slope_ray, where t = ρ sinh(−Y cos 2πu1'), sinh Y = tanθi: t = ρ at two of its values.
    y_max = jnp.arcsinh(grazing_tangent(wi))
    rest = (y_max - SEAM) * (y_max + SEAM)
    parted = rest > 0
    seam = jnp.where(parted, jnp.arctan2(jnp.sqrt(jnp.where(parted, rest, 1.0)), -SEAM), jnp.pi)
    away = u1 < 0.5
    lap = jnp.where(away, 4.0 * u1 - 1.0, 4.0 * u1 - jnp.where(u1 < 0.75, 2.0, 3.0))
    span = jnp.where(away, seam, 2.0 * (jnp.pi - seam))
    turn = jnp.where(away, lap * seam, seam + lap * span)
    ray = slope_ray(wi, turn / (2 * jnp.pi), alpha, alpha)
    tau = ray.lean / alpha
    end = jnp.minimum(ray.horizon, last)
    grazed = jnp.minimum(jnp.tan(jnp.arctan2(jnp.ones_like(tau), -tau) / 3.0) / alpha, end)
    facing = jnp.maximum(tau, 1.0)
    first, equal = jnp.minimum(1.0 / (facing * alpha), end), jnp.minimum(facing / alpha, end)
    inner, beyond = u2 < 0.5, u1 >= 0.75
    low = jnp.where(beyond, equal, jnp.where(inner, 0.0, jnp.where(away, grazed, first)))
    high = jnp.where(beyond, end, jnp.where(inner, jnp.where(away, grazed, first), jnp.where(away, end, equal)))
    s, rate = law(jnp.where(beyond, u2, 2.0 * u2 - jnp.where(inner, 0.0, 1.0)), low, high)
    wo, jacobian = facet_direction(wi, ray, s, rate * jnp.where(beyond, 1.0, 2.0), alpha, alpha)
    return wo, jacobian * (4.0 * span / (2 * jnp.pi))
