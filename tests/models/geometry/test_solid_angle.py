"""Solid angles against the textbook, against one another, and against plain quadrature."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gonio.models.geometry import solid_angle
from gonio.models.geometry.directions import Direction, from_spherical

X, Y, Z = (Direction(1.0, 0.0, 0.0), Direction(0.0, 1.0, 0.0), Direction(0.0, 0.0, 1.0))

projected_cap = jax.jit(solid_angle.projected_cap)
triangle = jax.jit(solid_angle.triangle)
projected_triangle = jax.jit(solid_angle.projected_triangle)


def gauss(n, low, high):
    x, w = np.polynomial.legendre.leggauss(n)
    return low + (high - low) * (x + 1) / 2, (high - low) / 2 * w


def test_whole_hemisphere_and_sphere():
    assert solid_angle.cap(np.pi / 2) == pytest.approx(solid_angle.HEMISPHERE, rel=1e-15)
    assert solid_angle.cap(np.pi) == pytest.approx(4 * np.pi, rel=1e-15)
    assert projected_cap(np.pi / 2) == pytest.approx(solid_angle.PROJECTED_HEMISPHERE, rel=1e-15)
    assert solid_angle.band(0.0, np.pi / 2) == pytest.approx(2 * np.pi, rel=1e-15)
    assert solid_angle.projected_band(0.0, np.pi / 2) == pytest.approx(np.pi, rel=1e-15)


@given(st.floats(0.0, np.pi))
def test_cap_is_a_band_and_is_inverted(s):
    assert solid_angle.cap(s) == pytest.approx(float(solid_angle.band(0.0, s)), rel=1e-14)
    assert solid_angle.half_angle_of_cap(solid_angle.cap(s)) == pytest.approx(s, rel=1e-7, abs=1e-12)


def test_small_shapes_keep_their_digits():
    s = 1e-9
    assert solid_angle.cap(s) == pytest.approx(np.pi * s**2, rel=1e-15)
    theta = 0.7
    expected = 2 * np.pi * np.sin(theta + s / 2) * s
    assert solid_angle.band(theta, theta + s) == pytest.approx(expected, rel=1e-6)  # theta + s is rounded


@given(st.floats(0.0, 1.5), st.floats(0.01, 0.07), st.floats(0.0, 6.0), st.floats(0.01, 0.5))
def test_patch_against_quadrature(theta, step, phi, width):
    x, w = gauss(12, theta, theta + step)
    found = solid_angle.patch(theta, theta + step, phi, phi + width)
    assert found == pytest.approx(width * np.sum(w * np.sin(x)), rel=1e-12)
    found = solid_angle.projected_patch(theta, theta + step, phi, phi + width)
    assert found == pytest.approx(width * np.sum(w * np.sin(x) * np.cos(x)), rel=1e-12, abs=1e-17)


@pytest.mark.parametrize("half_angle", [1e-4, 0.3, 1.2, np.pi / 2])
@pytest.mark.parametrize("theta", [0.0, 0.5, 1.4, np.pi / 2, 2.0])
def test_projected_cap_against_quadrature(half_angle, theta):
    # Rings about the axis: the part of a ring above the horizon in closed form, the rings by Gauss panels
    # that end where a ring first touches the horizon.
    touch = min(abs(np.pi / 2 - theta), half_angle)
    total = 0.0
    for low, high in ((0.0, touch), (touch, half_angle)):
        x, w = gauss(200, 0.0, 1.0)
        s = low + (high - low) * (1 - np.cos(np.pi * x)) / 2  # square-root ends
        w = w * (high - low) * np.pi * np.sin(np.pi * x) / 2
        a, b = np.cos(s) * np.cos(theta), np.sin(s) * np.sin(theta)
        psi = np.arccos(np.clip(-a / np.maximum(b, 1e-300), -1, 1))
        total += np.sum(w * np.sin(s) * 2 * (a * psi + b * np.sin(psi)))
    assert projected_cap(half_angle, theta) == pytest.approx(total, rel=1e-10, abs=1e-16)


def test_projected_cap_has_finite_gradients_where_the_horizon_touches_it():
    grad = jax.jit(jax.grad(solid_angle.projected_cap, argnums=(0, 1)))
    for s, t in (
        (0.3, np.pi / 2 - 0.3),
        (0.3, np.pi / 2 + 0.3),
        (np.pi / 2, 0.0),
        (0.3, 0.0),
        (0.3, np.pi / 2),
    ):
        assert np.all(np.isfinite(grad(s, t)))


def test_octant():
    assert triangle(X, Y, Z) == pytest.approx(np.pi / 2, rel=1e-15)
    assert triangle(Y, X, Z) == pytest.approx(-np.pi / 2, rel=1e-15)
    assert projected_triangle(X, Y, Z) == pytest.approx(np.pi / 4, rel=1e-15)


def test_a_patch_at_the_pole_is_a_triangle_and_a_sliver():
    # The pole, and two points of equal latitude: the triangle's area by Girard's angle excess.
    theta, phi = 0.8, 0.9
    a, b = from_spherical(theta, 0.0), from_spherical(theta, phi)
    base = np.arctan2(1.0, np.cos(theta) * np.tan(phi / 2))  # the angle at each foot (Napier)
    assert triangle(Z, a, b) == pytest.approx(phi + 2 * base - np.pi, rel=1e-13)


def corners(size, seed):
    rng = np.random.default_rng(seed)
    centre = rng.normal(size=3)
    centre[2] = abs(centre[2]) + 0.5
    c = centre / np.linalg.norm(centre) + size * rng.normal(size=(3, 3))
    c[:, 2] = np.abs(c[:, 2])
    return c / np.linalg.norm(c, axis=1, keepdims=True)


def test_tiny_triangles_keep_their_digits():
    # Exact arithmetic on the same binary corners: mpmath's 60 digits.
    mp = pytest.importorskip("mpmath")
    for size in (1e-2, 1e-5, 1e-8):
        a, b, c = corners(size, 7)
        with mp.workdps(60):
            m = mp.matrix(np.array([a, b, c]).tolist())
            lengths = [mp.norm(m[i, :]) for i in range(3)]
            dots = [mp.fsum(m[i, k] * m[j, k] for k in range(3)) for i, j in ((0, 1), (1, 2), (2, 0))]
            tan_half = mp.det(m) / (
                lengths[0] * lengths[1] * lengths[2]
                + dots[0] * lengths[2]
                + dots[1] * lengths[0]
                + dots[2] * lengths[1]
            )
            exact = float(2 * mp.atan(tan_half))
        assert triangle(Direction(*a), Direction(*b), Direction(*c)) == pytest.approx(exact, rel=1e-12)
        projected = projected_triangle(Direction(*a), Direction(*b), Direction(*c))
        # A rounding of the corners turns the plane of a triangle by eps/size.
        assert projected == pytest.approx(exact * a[2], rel=5 * size + 1e-15 / size)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from([0.9, 0.1]))
def test_triangles_add_up(seed, size):
    a, b, c = corners(size, seed)
    middle = a + b + c
    m = Direction(*(middle / np.linalg.norm(middle)))
    a, b, c = Direction(*a), Direction(*b), Direction(*c)
    for area in (triangle, projected_triangle):
        parts = area(a, b, m) + area(b, c, m) + area(c, a, m)
        assert parts == pytest.approx(float(area(a, b, c)), rel=1e-11, abs=1e-15)


def test_projected_triangle_against_quadrature():
    a, b, c = corners(0.5, 3)
    u, w = gauss(40, 0.0, 1.0)
    s, t = np.meshgrid(u, u, indexing="ij")
    flat = (1 - s)[..., None] * a + (s * (1 - t))[..., None] * b + (s * t)[..., None] * c
    # dω of a flat element at r: n·r/|r|³ dA, with n dA constant over the triangle.
    normal = np.cross(b - a, c - a)
    r = np.linalg.norm(flat, axis=-1)
    d_omega = (flat @ normal) / r**3 * np.outer(w * u, w)
    ends = [Direction(*v) for v in (a, b, c)]
    assert triangle(*ends) == pytest.approx(np.sum(d_omega), rel=1e-12)
    assert projected_triangle(*ends) == pytest.approx(np.sum(d_omega * flat[..., 2] / r), rel=1e-12)


def test_degenerate_triangles_have_no_area_and_finite_gradients():
    assert triangle(X, X, Z) == 0
    assert projected_triangle(X, X, Z) == pytest.approx(0, abs=1e-16)
    for area in (solid_angle.triangle, solid_angle.projected_triangle):
        grad = jax.jit(jax.grad(area, argnums=(0, 1, 2)))(X, X, Z)
        assert all(np.isfinite(g) for g in jax.tree.leaves(grad))
