"""What the half-vector lobes share: h and the half angle, log cosθ_h, cosines that may be divided by, and densities."""

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import NamedTuple

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction
from gonio.models.geometry.guards import grazing_scale, positive

UNEVEN = 16.0
"""Difference of two squared lengths, in roundings, up to which both directions are taken as unit vectors."""


class HalfAngles(NamedTuple):
    """The unit half vector h; cosθ_d = wi·h = |wi + wo|/2; and sin²θ_h."""

    h: Direction
    cos_d: Scalar
    sin2_h: Scalar


class _Stated(NamedTuple):
    """Half angles that are known beforehand, and the pairs of directions that they are of: one, and what guards made of
    it."""

    half: HalfAngles
    pairs: list[tuple[Direction, Direction]]

    def of(self, wi: Direction, wo: Direction) -> bool:
        """Whether these are the very directions, in either order."""
        return any((wi is a and wo is b) or (wi is b and wo is a) for a, b in self.pairs)


_stated: ContextVar[_Stated | None] = ContextVar("stated half angles", default=None)


@contextlib.contextmanager
def stated_half_angles(wi: Direction, wo: Direction, half: HalfAngles | None) -> Iterator[None]:
    """Within it `half_angles` of this very pair, guarded or not, is `half`, as a grid of half vectors has it.

    It is then computed once for an axis rather than in each cell, and loses no digits in the sum of two directions.
    Nothing is stated where `half` is None.
    """
    token = _stated.set(None if half is None else _Stated(half, [(wi, wo)]))
    try:
        yield
    finally:
        _stated.reset(token)


def stands_for(guarded: tuple[Direction, Direction], wi: Direction, wo: Direction) -> None:
    """Note that a guarded pair is (wi, wo) wherever its value counts."""
    stated = _stated.get()
    if stated is not None and stated.of(wi, wo):
        stated.pairs.append(guarded)


def half_angles(wi: Direction, wo: Direction) -> HalfAngles:
    """h, cosθ_d and sin²θ_h of two unit directions; the normal where they are opposite, where cosθ_d is 0.

    wi + wo is lifted by a power of two before it is squared: two grazing directions that nearly cancel underflow
    otherwise. cosθ_d is half its length; as wi·h, which is a difference there, it would lose its digits. Only where the
    two lengths differ by more than rounding (single-precision directions handed over in double) is wi·h taken to the
    letter, as renderers do: it is longer by (|wi|² − |wo|²)/(2|wi + wo|).
    """
    stated = _stated.get()
    if stated is not None and stated.of(wi, wo):
        return stated.half
    dtype = jnp.result_type(wi.x, wo.x)
    up = grazing_scale(dtype)
    x, y, z = ((a + b) * up for a, b in zip(wi, wo, strict=True))
    length2 = x * x + y * y + z * z
    null = length2 <= 0
    inverse = 1.0 / jnp.sqrt(jnp.where(null, 1.0, length2))
    h = Direction(x * inverse, y * inverse, jnp.where(null, 1.0, z * inverse))
    uneven = (wi.x - wo.x) * (wi.x + wo.x) + (wi.y - wo.y) * (wi.y + wo.y) + (wi.z - wo.z) * (wi.z + wo.z)
    uneven = jnp.where(jnp.abs(uneven) > UNEVEN * float(jnp.finfo(dtype).eps), uneven, 0.0)
    cos_d = inverse * (length2 * (0.5 / up) + uneven * (0.5 * up))
    return HalfAngles(h, jnp.clip(cos_d, 0.0, 1.0), h.x**2 + h.y**2)


def log_cosine(h: Direction, sin2_h: Scalar) -> Scalar:
    """log h.z of a unit vector with h.z > 0: by log1p near the normal, where the cosine has no digits of its own.

    Not beyond −0.25: XLA's log1p is off by 3e-14 from −0.41 to −0.3 on the CPU.
    """
    near = sin2_h < 0.25
    return jnp.where(near, 0.5 * jnp.log1p(-jnp.where(near, sin2_h, 0.0)), jnp.log(jnp.where(near, 1.0, positive(h.z))))


def mirrored_pdf(projected_density: Callable[[Direction], Scalar], wi: Direction, wo: Direction) -> Scalar:
    """Density, 1/sr, of wi mirrored in facets drawn with `projected_density(m)` (1/sr of m, 0 for m.z ≤ 0)."""
    h, cos_d, _ = half_angles(wi, wo)
    up = jnp.where(h.z < 0, -1.0, 1.0)
    facing = cos_d > 0
    value = projected_density(Direction(*(up * c for c in h))) / (4.0 * jnp.where(facing, cos_d, 1.0))
    return jnp.where(facing, value, 0.0)
