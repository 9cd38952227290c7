"""Directions: both coordinate systems, both ways, where they are delicate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.models.geometry import directions as g
from gonio.models.geometry.directions import Direction

RNG = np.random.default_rng(3)


def random_directions(n):
    z = RNG.uniform(0, 1, n)
    phi = RNG.uniform(0, 2 * np.pi, n)
    s = np.sqrt(1 - z * z)
    return Direction(s * np.cos(phi), s * np.sin(phi), z)


def matrix_pair(theta_h, phi_h, theta_d, phi_d):
    """Rusinkiewicz's definition by rotation matrices, in NumPy: wi = Rz(phi_h) Ry(theta_h) d."""
    c, s = np.cos(theta_h), np.sin(theta_h)
    ry = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = np.cos(phi_h), np.sin(phi_h)
    rz = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    d = np.array([np.sin(theta_d) * np.cos(phi_d), np.sin(theta_d) * np.sin(phi_d), np.cos(theta_d)])
    h = rz @ ry @ np.array([0, 0, 1])
    wi = rz @ ry @ d
    return wi, 2 * (wi @ h) * h - wi


ANGLE = st.floats(0, np.pi / 2 - 1e-6)
TURN = st.floats(0, 2 * np.pi - 1e-6)


@settings(max_examples=60, deadline=None)
@given(ANGLE, TURN, ANGLE, TURN)
def test_half_difference_is_rusinkiewicz_by_matrices(theta_h, phi_h, theta_d, phi_d):
    wi, wo = g.from_half_difference(*map(jnp.asarray, (theta_h, phi_h, theta_d, phi_d)))
    ref_i, ref_o = matrix_pair(theta_h, phi_h, theta_d, phi_d)
    np.testing.assert_allclose(np.stack(wi), ref_i, atol=4e-16)
    np.testing.assert_allclose(np.stack(wo), ref_o, atol=6e-16)


def test_half_difference_both_ways():
    wi, wo = random_directions(4000), random_directions(4000)
    back_i, back_o = g.from_half_difference(*g.to_half_difference(wi, wo))
    for a, b in zip((*wi, *wo), (*back_i, *back_o), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-15)


def test_spherical_both_ways_down_to_the_pole():
    theta = np.r_[np.geomspace(1e-12, 1.5, 200), np.pi / 2]
    phi = np.linspace(0, 2 * np.pi, theta.size, endpoint=False)
    back_theta, back_phi = g.to_spherical(g.from_spherical(theta, phi))
    np.testing.assert_allclose(back_theta, theta, rtol=2e-15)
    np.testing.assert_allclose(back_phi, phi, atol=1e-14)


def test_small_difference_angles_keep_their_digits():
    """wi ≈ wo at grazing: theta_d from acos would be wrong in half of its digits."""
    theta_d = np.geomspace(1e-10, 1e-2, 40)
    angles = [np.full_like(theta_d, a) for a in (1.4, 0.3)]
    wi, wo = g.from_half_difference(angles[0], angles[1], theta_d, np.full_like(theta_d, 1.0))
    found = g.to_half_difference(wi, wo)
    np.testing.assert_allclose(found[2], theta_d, atol=3e-16, rtol=1e-12)
    np.testing.assert_allclose(found[3][theta_d > 1e-6], 1.0, rtol=1e-8)


def test_equal_and_opposite_directions_are_defined():
    w = Direction(jnp.asarray(1.0), jnp.asarray(0.0), jnp.asarray(0.0))
    opposite = Direction(*(-c for c in w))
    theta_h, phi_h, theta_d, phi_d = g.to_half_difference(w, w)
    assert (float(theta_d), float(phi_d)) == (0.0, 0.0) and float(theta_h) == pytest.approx(np.pi / 2)
    theta_h, phi_h, theta_d, phi_d = g.to_half_difference(w, opposite)
    assert (float(theta_h), float(phi_h)) == (0.0, 0.0) and float(theta_d) == pytest.approx(np.pi / 2)
    assert np.isfinite(float(phi_d))


def test_gradients_are_finite_where_angles_are_not_defined():
    up = jnp.array([0.0, 0.0, 1.0])
    grazing = jnp.array([1.0, 0.0, 0.0])

    def angles(v):
        return sum(g.to_half_difference(Direction(*v[:3]), Direction(*v[3:])))

    pairs = ((up, up), (grazing, grazing), (grazing, -grazing), (up, grazing))
    assert np.all(np.isfinite(jax.jit(jax.vmap(jax.grad(angles)))(jnp.array([jnp.concatenate(p) for p in pairs]))))


def test_swapping_turns_the_difference_azimuth_by_half_a_turn():
    wi, wo = random_directions(500), random_directions(500)
    one, two = g.to_half_difference(wi, wo), g.to_half_difference(wo, wi)
    np.testing.assert_allclose(np.cos(one[3]), -np.cos(two[3]), atol=1e-12)
    np.testing.assert_allclose(one[2], two[2], atol=1e-15)


def test_reflection_about_the_half_vector_exchanges_the_pair():
    wi, wo = random_directions(500), random_directions(500)
    for a, b in zip(g.reflect(wi, g.half_vector(wi, wo)), wo, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-13)


def test_vector_products_agree_with_numpy():
    a, b = random_directions(50), random_directions(50)
    np.testing.assert_allclose(np.stack(g.cross(a, b), -1), np.cross(np.stack(a, -1), np.stack(b, -1)), atol=1e-15)
    np.testing.assert_allclose(g.norm(g.add(a, g.scale(2.0, b))), np.linalg.norm(np.stack(a) + 2 * np.stack(b), axis=0))
