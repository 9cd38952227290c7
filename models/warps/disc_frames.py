"""Discs of directions, laid out gnomonically: a disc about n is n + tan s·(x t + y b), with t towards the normal.

The horizon is then the straight line x = const: a disc is cut along a chord, at x = cos ψ for a ψ from 0 to π.
Where two discs are looked at together, t lies in the plane of both axes instead, and b is normal to it.
"""

from types import ModuleType
from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import polar_parts

PARALLEL = 1e-9  # sine of the angle between two directions up to which any plane through them is theirs


class DiscFrame(NamedTuple):
    """The frame of a disc: its axis, the unit tangent towards the normal, the horizontal one (x, y), and tan s."""

    axis: Direction
    up: Direction
    across: tuple[Scalar, Scalar]
    tan_s: Scalar


def disc_frame(axis: Direction, tan_s: Scalar) -> DiscFrame:
    """The frame of the disc about a unit direction whose half-angle s in [0, π/2) has this tangent."""
    sin_t, cos_p, sin_p = polar_parts(axis)
    return DiscFrame(axis, Direction(-axis.z * cos_p, -axis.z * sin_p, sin_t), (-sin_p, cos_p), tan_s)


def psi_of_horizon(frame: DiscFrame) -> Scalar:
    """ψ in [0, π], radians, where the horizon cuts the disc: π where it is wholly above, 0 where below."""
    reach = frame.axis.z / jnp.maximum(frame.up.z * frame.tan_s, 1e-30)
    return jnp.arccos(jnp.clip(-reach, -1.0, 1.0))


def disc_ray(frame: DiscFrame, x: Scalar, y: Scalar) -> tuple[Direction, Scalar]:
    """(direction, cosθ dω/(dx dy) up to a factor of the disc, 0 below the horizon) at (x, y) in units of the axis."""
    axis, up, (b_x, b_y) = frame.axis, frame.up, frame.across
    inverse = 1.0 / jnp.sqrt(1.0 + x * x + y * y)
    ray = Direction(
        (axis.x + x * up.x + y * b_x) * inverse,
        (axis.y + x * up.y + y * b_y) * inverse,
        (axis.z + x * up.z) * inverse,
    )
    return ray, inverse**3 * jnp.maximum(ray.z, 0.0)


def pair_normal(wi: Direction, wo: Direction, xp: ModuleType = jnp) -> Direction:
    """The unit normal of the plane of two directions, by JAX or NumPy; horizontal where they are parallel."""
    cross = (wi.y * wo.z - wi.z * wo.y, wi.z * wo.x - wi.x * wo.z, wi.x * wo.y - wi.y * wo.x)
    sine, sine_i = xp.sqrt(sum(c * c for c in cross)), xp.sqrt(wi.x**2 + wi.y**2)
    apart, tilted = sine > PARALLEL, sine_i > PARALLEL
    length, horizontal = xp.where(apart, sine, 1.0), xp.where(tilted, sine_i, 1.0)
    other = (xp.where(tilted, -wi.y / horizontal, 0.0), xp.where(tilted, wi.x / horizontal, 1.0), xp.zeros_like(wi.z))
    return Direction(*(xp.where(apart, c / length, e) for c, e in zip(cross, other, strict=True)))


def ray_about(axis: Direction, normal: Direction, x: Scalar, y: Scalar) -> tuple[Direction, Scalar]:
    """As `disc_ray`, at axis + x t + y b where b is a unit normal of the axis, and t = b × axis."""
    inverse = 1.0 / jnp.sqrt(1.0 + x * x + y * y)
    ray = Direction(
        (axis.x + x * (normal.y * axis.z - normal.z * axis.y) + y * normal.x) * inverse,
        (axis.y + x * (normal.z * axis.x - normal.x * axis.z) + y * normal.y) * inverse,
        (axis.z + x * (normal.x * axis.y - normal.y * axis.x) + y * normal.z) * inverse,
    )
    return ray, inverse**3 * jnp.maximum(ray.z, 0.0)
