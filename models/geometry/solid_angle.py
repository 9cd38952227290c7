"""Solid angles of the simple shapes, and their projected solid angles ∫ cosθ dω in closed form.

Angles in radians, solid angles in steradians; scalar functions of JAX (shapes broadcast). Every form is
written so that small shapes keep their digits: no difference of two cosines.
"""

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction, add, cross, dot, norm, safe_atan2

HEMISPHERE = 2 * jnp.pi
PROJECTED_HEMISPHERE = jnp.pi


def cap(half_angle: Scalar) -> Scalar:
    """Solid angle 2π(1 − cos s), sr, of a cap of half-angle s in [0, π]."""
    return 4 * jnp.pi * jnp.sin(half_angle / 2) ** 2


def half_angle_of_cap(solid_angle: Scalar) -> Scalar:
    """Half-angle, radians, of the cap of a solid angle in [0, 4π] sr: the inverse of `cap`."""
    return 2 * jnp.arcsin(jnp.sqrt(solid_angle / (4 * jnp.pi)))


def _segment(x: Scalar) -> Scalar:
    # x − sin x cos x, to full precision at 0.
    small = jnp.abs(x) < 0.1
    t2 = jnp.where(small, 2 * x, 0.0) ** 2
    series = x * t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72 * (1 - t2 / 110))))
    return jnp.where(small, series, x - jnp.sin(x) * jnp.cos(x))


def projected_cap(half_angle: Scalar, theta: Scalar = 0.0) -> Scalar:
    """∫ cosθ dω, sr, of the part above the horizon of a cap of half-angle s about an axis at `theta`.

    s in (0, π/2], theta in [0, π]. π sin²s cos θ where the whole cap is above the horizon; across it, the
    boundary integral ½∮(r × dr)·n over the visible part of the rim and the chord of horizon between its
    ends (Lambert 1760).
    """
    cos_s, sin_s, cos_t = jnp.cos(half_angle), jnp.sin(half_angle), jnp.cos(theta)
    # The rim is cos s·axis + sin s·(cos ψ, sin ψ): above the horizon for |ψ| < psi_0. The horizon lies in
    # the cap for azimuths |φ| < phi_0 from the axis.
    crossing2 = (sin_s - cos_t) * (sin_s + cos_t)
    crosses = crossing2 > 0
    root = jnp.where(crosses, jnp.sqrt(jnp.where(crosses, crossing2, 1.0)), 0.0)
    psi_0 = safe_atan2(root, -cos_s * cos_t)
    phi_0 = safe_atan2(root, cos_s)
    part = psi_0 * sin_s**2 * cos_t + _segment(phi_0) + cos_t**2 * jnp.sin(phi_0) * jnp.cos(phi_0)
    whole = jnp.pi * sin_s**2 * jnp.maximum(cos_t, 0.0)
    return jnp.where(crosses, part, whole)


def band(theta_1: Scalar, theta_2: Scalar) -> Scalar:
    """Solid angle 2π(cos θ1 − cos θ2), sr, between two polar angles, 0 ≤ theta_1 ≤ theta_2 ≤ π."""
    return patch(theta_1, theta_2, 0.0, 2 * jnp.pi)


def projected_band(theta_1: Scalar, theta_2: Scalar) -> Scalar:
    """∫ cosθ dω = π(sin²θ2 − sin²θ1), sr, between two polar angles, 0 ≤ theta_1 ≤ theta_2 ≤ π/2."""
    return projected_patch(theta_1, theta_2, 0.0, 2 * jnp.pi)


def patch(theta_1: Scalar, theta_2: Scalar, phi_1: Scalar, phi_2: Scalar) -> Scalar:
    """Solid angle (φ2 − φ1)(cos θ1 − cos θ2), sr, of a rectangle in polar angle and azimuth."""
    return (phi_2 - phi_1) * 2 * jnp.sin((theta_2 + theta_1) / 2) * jnp.sin((theta_2 - theta_1) / 2)


def projected_patch(theta_1: Scalar, theta_2: Scalar, phi_1: Scalar, phi_2: Scalar) -> Scalar:
    """∫ cosθ dω = ½(φ2 − φ1)(sin²θ2 − sin²θ1), sr, of a rectangle in angle and azimuth above the horizon."""
    return 0.5 * (phi_2 - phi_1) * jnp.sin(theta_2 + theta_1) * jnp.sin(theta_2 - theta_1)


def _minus(a: Direction, b: Direction) -> Direction:
    return Direction(a.x - b.x, a.y - b.y, a.z - b.z)


def triangle(a: Direction, b: Direction, c: Direction) -> Scalar:
    """Signed solid angle, sr, of a spherical triangle of unit vectors [van Oosterom & Strackee 1983, eq. 8].

    Positive where a, b, c run counter-clockwise seen from outside the sphere; |Ω| ≤ 2π. The triple product
    is taken from the differences of the corners, which are exact for near corners, so a triangle of 1e-8
    rad keeps its digits.
    """
    triple = dot(a, cross(_minus(b, a), _minus(c, a)))
    return 2 * safe_atan2(triple, 1 + dot(a, b) + dot(b, c) + dot(c, a))


def _edge(a: Direction, b: Direction) -> Scalar:
    # (a × b)_z (γ/sin γ − 1), γ the angle between a and b.
    difference = _minus(b, a)
    sin_g = norm(cross(a, difference))
    gamma = 2 * safe_atan2(norm(difference), norm(add(a, b)))
    small = gamma < 0.02
    g2 = jnp.where(small, gamma, 0.0) ** 2
    series = g2 / 6 * (1 + 7 * g2 / 60 * (1 + 31 * g2 / 294))
    excess = jnp.where(small, series, gamma / jnp.where(small, 1.0, sin_g) - 1)
    return (a.x * difference.y - a.y * difference.x) * excess


def projected_triangle(a: Direction, b: Direction, c: Direction) -> Scalar:
    """Signed ∫ cosθ dω, sr, of a spherical triangle whose corners (unit vectors) are all above the horizon.

    Lambert's formula ½ Σ γ (a × b)·n/|a × b| over the edges (Lambert 1760; as in Baum, Rushmeier & Winget
    1989), rearranged so that the flat triangle is taken out first: no cancellation for small ones. Sign as
    `triangle`.
    """
    u, v = _minus(b, a), _minus(c, a)
    return 0.5 * (u.x * v.y - u.y * v.x + _edge(a, b) + _edge(b, c) + _edge(c, a))
