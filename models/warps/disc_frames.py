"""Discs of directions, laid out gnomonically: a disc about n is n + tan s·(x t + y b), with t towards the normal.

The horizon is then the straight line x = const: a disc is cut along a chord, at x = cos ψ for a ψ from 0 to π.
"""

from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.warps.grazing_azimuth import polar_parts


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
