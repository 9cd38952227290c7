"""What the half-vector lobes share: h and the half angle, log cosθ_h, cosines that may be divided by, and densities."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gonio.models.cosine_floor import positive
from gonio.models.geometry import NORMAL, Direction

Scalar = Float[Array, ""]

UNEVEN = 16.0
"""Difference of two squared lengths, in roundings, up to which both directions are taken as unit vectors."""


class HalfAngles(NamedTuple):
    """The unit half vector h; cosθ_d = wi·h = |wi + wo|/2; and sin²θ_h."""

    h: Direction
    cos_d: Scalar
    sin2_h: Scalar


def half_angles(wi: Direction, wo: Direction) -> HalfAngles:
    """h, cosθ_d and sin²θ_h of two unit directions; the normal where they are opposite, where cosθ_d is 0.

    wi + wo is scaled before it is squared: two grazing directions that nearly cancel underflow otherwise. cosθ_d is
    half its length; as wi·h, which is a difference there, it would lose its digits. Only where the two lengths differ
    by more than rounding (single-precision directions handed over in double) is wi·h taken to the letter, as
    renderers do: it is longer by (|wi|² − |wo|²)/(2|wi + wo|).
    """
    x, y, z = (a + b for a, b in zip(wi, wo, strict=True))
    largest = jax.lax.stop_gradient(jnp.maximum(jnp.maximum(jnp.abs(x), jnp.abs(y)), jnp.abs(z)))
    null = largest <= 0
    unit = jnp.where(null, 1.0, largest)
    x, y, z = (jnp.where(null, e, c / unit) for c, e in zip((x, y, z), NORMAL, strict=True))
    length = jnp.sqrt(x * x + y * y + z * z)
    h = Direction(x / length, y / length, z / length)
    uneven = sum((a - b) * (a + b) for a, b in zip(wi, wo, strict=True))
    literal = jnp.abs(uneven) > UNEVEN * jnp.finfo(jnp.result_type(length)).eps
    cos_d = 0.5 * unit * length + jnp.where(literal, 0.5 * uneven / (unit * length), 0.0)
    return HalfAngles(h, jnp.where(null, 0.0, jnp.clip(cos_d, 0.0, 1.0)), h.x**2 + h.y**2)


def log_cosine(h: Direction, sin2_h: Scalar) -> Scalar:
    """log h.z of a unit vector with h.z > 0: by log1p near the normal, where the cosine has no digits of its own.

    Not beyond −0.25: XLA's log1p is off by 3e-14 from −0.41 to −0.3 on the CPU.
    """
    near = sin2_h < 0.25
    return jnp.where(near, 0.5 * jnp.log1p(-jnp.where(near, sin2_h, 0.0)), jnp.log(jnp.where(near, 1.0, positive(h.z))))


def mirrored_pdf(projected_density, wi: Direction, wo: Direction) -> Scalar:
    """Density, 1/sr, of wi mirrored in facets drawn with `projected_density(m)` (1/sr of m, 0 for m.z ≤ 0)."""
    h, cos_d, _ = half_angles(wi, wo)
    up = jnp.where(h.z < 0, -1.0, 1.0)
    facing = cos_d > 0
    value = projected_density(Direction(*(up * c for c in h))) / (4.0 * jnp.where(facing, cos_d, 1.0))
    return jnp.where(facing, value, 0.0)
