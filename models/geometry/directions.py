"""Directions of the local frame, and the two coordinate systems of a BRDF table.

Conventions, for the whole of gonio: +z is the surface normal; `wi` points from the surface to the light, `wo` to the
detector; both are unit vectors. theta is the polar angle from +z, phi the azimuth, in radians.
"""

from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

from gonio.models.arrays import Scalar
from gonio.models.deferred import deferred

if TYPE_CHECKING:
    import jax.numpy as jnp
else:
    jnp = deferred("jax.numpy")


class Direction(NamedTuple):
    """A direction (or any vector) of the local frame by its components, each of the same shape.

    Components, not an array with a trailing axis of 3: this form compiles to code about twice as fast.
    """

    x: Scalar
    y: Scalar
    z: Scalar


NORMAL = (0.0, 0.0, 1.0)


def dot(a: Direction, b: Direction) -> Scalar:
    """Scalar product of two vectors; shapes broadcast."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Direction, b: Direction) -> Direction:
    """Vector product a × b; shapes broadcast."""
    return Direction(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def add(a: Direction, b: Direction) -> Direction:
    """a + b, component by component."""
    return Direction(a.x + b.x, a.y + b.y, a.z + b.z)


def scale(s: Scalar, a: Direction) -> Direction:
    """s · a, component by component."""
    return Direction(s * a.x, s * a.y, s * a.z)


def _guarded_sqrt(x: Scalar) -> Scalar:
    # sqrt has an infinite slope at 0, and 0 · inf is NaN in a gradient: a safe operand first, then the selection.
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)


def norm(a: Direction) -> Scalar:
    """Length of a vector; its gradient at the null vector is 0, not NaN."""
    return _guarded_sqrt(dot(a, a))


def normalize(a: Direction, fallback: Direction | tuple = NORMAL) -> Direction:
    """The unit vector along `a`; `fallback` where `a` is the null vector."""
    length2 = dot(a, a)
    null = length2 <= 0
    inverse = 1.0 / jnp.sqrt(jnp.where(null, 1.0, length2))
    return Direction(*(jnp.where(null, e, c * inverse) for c, e in zip(a, fallback, strict=True)))


def safe_atan2(y: Scalar, x: Scalar) -> Scalar:
    """atan2(y, x), and 0 with a finite gradient where both are 0."""
    null = (x == 0) & (y == 0)
    return jnp.arctan2(jnp.where(null, 0.0, y), jnp.where(null, 1.0, x))


def from_spherical(theta: Scalar, phi: Scalar, xp: ModuleType = jnp) -> Direction:
    """Unit vector of polar angle `theta` in [0, π] and azimuth `phi`, radians; shapes broadcast; `xp`: JAX or NumPy."""
    sin_t = xp.sin(theta)
    return Direction(*xp.broadcast_arrays(sin_t * xp.cos(phi), sin_t * xp.sin(phi), xp.cos(theta)))


def to_spherical(w: Direction) -> tuple[Scalar, Scalar]:
    """(theta in [0, π], phi in [0, 2π)), radians, of a vector of any length; phi = 0 at the pole.

    By atan2: acos(z) loses half of the digits near the pole, where w.z = 1 − theta²/2.
    """
    theta = safe_atan2(_guarded_sqrt(w.x**2 + w.y**2), w.z)
    phi = safe_atan2(w.y, w.x)
    phi = jnp.where(phi < 0, phi + 2 * jnp.pi, phi)
    return theta, jnp.where(phi >= 2 * jnp.pi, 0.0, phi)


def half_vector(wi: Direction, wo: Direction) -> Direction:
    """Unit vector half-way between `wi` and `wo`; the normal where they are opposite."""
    return normalize(add(wi, wo))


def reflect(w: Direction, m: Direction) -> Direction:
    """Mirror image 2(w·m)m − w of a direction about the unit vector `m`."""
    twice = 2.0 * dot(w, m)
    return Direction(twice * m.x - w.x, twice * m.y - w.y, twice * m.z - w.z)


def pair_from_half_difference_trig(
    cos_h: Scalar, sin_h: Scalar, cos_d: Scalar, sin_d: Scalar, cos_phi_d: Scalar, sin_phi_d: Scalar
) -> tuple[Direction, Direction]:
    """(wi, wo) of half/difference coordinates at phi_h = 0, from cosines and sines already at hand.

    [Rusinkiewicz 1998]: wi = R_y(theta_h) d, wo its mirror image about h; here d has the azimuth phi_d of `wi`.
    Table kernels take the trigonometry of each axis as an input; XLA would otherwise repeat it in every cell.
    """
    d_x, d_y = sin_d * cos_phi_d, sin_d * sin_phi_d
    along, across = cos_h * d_x, sin_h * d_x
    forward, up = sin_h * cos_d, cos_h * cos_d
    return Direction(forward + along, d_y, up - across), Direction(forward - along, -d_y, up + across)


def rotate_z(w: Direction, cos_phi: Scalar, sin_phi: Scalar) -> Direction:
    """`w` turned about the normal by the azimuth whose cosine and sine are given."""
    return Direction(w.x * cos_phi - w.y * sin_phi, w.x * sin_phi + w.y * cos_phi, w.z)


def from_half_difference(theta_h: Scalar, phi_h: Scalar, theta_d: Scalar, phi_d: Scalar) -> tuple[Direction, Direction]:
    """(wi, wo) of Rusinkiewicz's half/difference angles, radians; shapes broadcast [Rusinkiewicz 1998, §3].

    theta_h in [0, π/2], phi_h in [0, 2π) locate the half vector; theta_d in [0, π/2], phi_d in [0, 2π) locate `wi` in
    the frame of the half vector. phi_d + π swaps `wi` and `wo`.
    """
    angles = jnp.broadcast_arrays(theta_h, phi_h, theta_d, phi_d)
    (ch, cp, cd, cq), (sh, sp, sd, sq) = zip(*((jnp.cos(a), jnp.sin(a)) for a in angles), strict=True)
    wi, wo = pair_from_half_difference_trig(ch, sh, cd, sd, cq, sq)
    return rotate_z(wi, cp, sp), rotate_z(wo, cp, sp)


def to_half_difference(wi: Direction, wo: Direction) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """(theta_h, phi_h, theta_d, phi_d), radians, of a pair of unit directions [Rusinkiewicz 1998, §3].

    Stable at the pole (phi_h = 0), at grazing, for wi = wo (theta_d = 0, phi_d = 0) and for opposite directions (h is
    then the normal): theta_d comes from |wi − wo| and |wi + wo|, never from acos.
    """
    h = half_vector(wi, wo)
    theta_h, phi_h = to_spherical(h)
    difference = Direction(wi.x - wo.x, wi.y - wo.y, wi.z - wo.z)
    theta_d = safe_atan2(norm(difference), norm(add(wi, wo)))
    cos_p, sin_p = jnp.cos(phi_h), jnp.sin(phi_h)
    # The component of wi along h cancels in wi − wo, so its tangential part keeps all digits when wi ≈ wo.
    turned = rotate_z(difference, cos_p, -sin_p)
    tangent = jnp.cos(theta_h) * turned.x - jnp.sin(theta_h) * turned.z
    phi_d = safe_atan2(turned.y, tangent)
    phi_d = jnp.where(phi_d < 0, phi_d + 2 * jnp.pi, phi_d)
    return theta_h, phi_h, theta_d, jnp.where(phi_d >= 2 * jnp.pi, 0.0, phi_d)
