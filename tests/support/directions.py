"""Directions and normals that resolve any lobe, for tests of models."""

import jax.numpy as jnp
import numpy as np

from gonio.models.geometry.directions import Direction, from_spherical


def slope_grid(alpha_x, alpha_y, n=400):
    """Normals and solid angles dω_m that resolve any width: polar in the scaled slopes, radius = tan of the node."""
    x, w = np.polynomial.legendre.leggauss(n)
    t, wt = (x + 1) / 2, w / 2
    phi = (np.arange(n) + 0.5) / n * 2 * np.pi
    t, phi = np.meshgrid(t, phi, indexing="ij")
    r = t / (1 - t)
    p, q = alpha_x * r * np.cos(phi), alpha_y * r * np.sin(phi)
    z = 1 / np.sqrt(1 + p * p + q * q)
    area = (wt[:, None] * 2 * np.pi / n) * r / (1 - t) ** 2 * alpha_x * alpha_y * z**3
    return Direction(p * z, q * z, z), area


def random_angles(n: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray, Direction, Direction]:
    """(theta, phi) of light and detector, (2, n) each, theta up to 89°, and the two directions."""
    rng = np.random.default_rng(seed)
    theta, phi = rng.uniform(0, 1.55, (2, n)), rng.uniform(0, 2 * np.pi, (2, n))
    wi, wo = (from_spherical(jnp.asarray(t), jnp.asarray(p)) for t, p in zip(theta, phi, strict=True))
    return theta, phi, wi, wo


def random_pairs(n=300):
    """Pairs of directions of which some graze the surface, down to a height of 1e-6."""
    v = np.random.default_rng(3).normal(size=(n, 2, 3))
    v[..., 2] = np.abs(v[..., 2]) * np.logspace(-6, 0, n)[:, None]
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    return (Direction(*v[:, k].T) for k in (0, 1))
