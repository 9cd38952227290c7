"""Azimuths about a mirror direction, clustered where the horizon of a grazing lobe turns quickly."""

import jax.numpy as jnp

from gonio.models.arrays import Scalar
from gonio.models.geometry.directions import Direction

TANGENT_MAX = 1e8  # the layer that a grazing horizon makes in azimuth is then 1e-8 rad wide: nothing is in it


def polar_parts(w: Direction) -> tuple[Scalar, Scalar, Scalar]:
    """(sin θ, cos φ, sin φ) of a unit vector; (0, 1, 0) at the normal, where the gradients are 0."""
    sin2 = w.x**2 + w.y**2
    tilted = sin2 > 0
    sin_t = jnp.where(tilted, jnp.sqrt(jnp.where(tilted, sin2, 1.0)), 0.0)
    length = jnp.where(tilted, sin_t, 1.0)
    return sin_t, jnp.where(tilted, w.x / length, 1.0), jnp.where(tilted, w.y / length, 0.0)


def rotated(cos_a: Scalar, sin_a: Scalar, x: Scalar, y: Scalar) -> tuple[Scalar, Scalar]:
    """(x, y) turned by the angle a."""
    return x * cos_a - y * sin_a, x * sin_a + y * cos_a


def grazing_tangent(w: Direction) -> Scalar:
    """tan θ of a direction on or above the horizon, at most `TANGENT_MAX`; gradients are finite."""
    return polar_parts(w)[0] / jnp.maximum(w.z, 1.0 / TANGENT_MAX)


def _sinhc(x: Scalar) -> Scalar:
    """sinh(x)/x, to full precision at 0."""
    small = jnp.abs(x) < 0.3
    safe = jnp.where(small, 1.0, x)
    x2 = jnp.where(small, x, 0.0) ** 2
    series = 1 + x2 / 6 * (1 + x2 / 20 * (1 + x2 / 42 * (1 + x2 / 72 * (1 + x2 / 110))))
    return jnp.where(small, series, jnp.sinh(safe) / safe)


def grazing_azimuth(tan_i: Scalar, u1: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """(cos ψ, sin ψ, |dψ/du1|) for u1 in [0, 1]: ψ runs from π over π/2, 0, −π/2 to −π at u1 = 0, ¼, ½, ¾, 1.

    An integral bounded by the horizon of a lobe about a direction of polar angle θ_i depends on
    tan θ_i · cos ψ, so near grazing everything happens within cot θ_i of ψ = ±π/2. Hence
    cos ψ = sinh(y)/tan θ_i with y = −Y cos(2πu1), sinh Y = tan θ_i: smooth in y at any tan θ_i in [0, ∞],
    equal steps of azimuth at tan θ_i = 0. The Jacobian is periodic and smooth in u1.
    """
    big_y = jnp.arcsinh(jnp.minimum(tan_i, TANGENT_MAX))
    cos_u, sin_u = jnp.cos(2 * jnp.pi * u1), jnp.sin(2 * jnp.pi * u1)
    y = -big_y * cos_u
    # 1 − sinh²y/sinh²Y = sinh(Y+y) sinh(Y−y)/sinh²Y, without the cancellation.
    ends = jnp.sqrt(_sinhc(2 * big_y * jnp.sin(jnp.pi * u1) ** 2) * _sinhc(2 * big_y * jnp.cos(jnp.pi * u1) ** 2))
    cos_psi = -cos_u * _sinhc(y)
    sin_psi = sin_u * ends
    norm = jnp.sqrt(cos_psi**2 + sin_psi**2)
    return cos_psi / norm, sin_psi / norm, 2 * jnp.pi * jnp.cosh(y) / ends
