"""Angles of pairs of directions, and the order in which neighbours follow each other."""

import numpy as np

from gonio.fitting.residuals.pair_angles import _spread, neighbour_order, pair_angles
from gonio.models.geometry.directions import from_spherical


def test_angles_of_mirror_and_retro_pairs():
    theta, phi = np.radians([10.0, 40.0, 70.0]), np.zeros(3)
    wi = from_spherical(theta, phi)
    mirror, retro = (pair_angles(wi, from_spherical(theta, phi + turn)) for turn in (np.pi, 0.0))
    np.testing.assert_allclose(mirror.theta_i, [10, 40, 70], rtol=1e-6)
    np.testing.assert_allclose(mirror.theta_h, 0, atol=1e-5)
    np.testing.assert_allclose(mirror.theta_d, [10, 40, 70], rtol=1e-6)
    np.testing.assert_allclose(retro.theta_h, [10, 40, 70], rtol=1e-6)
    np.testing.assert_allclose(retro.phase, 0, atol=1e-5)


def test_neighbours_follow_each_other():
    rng = np.random.default_rng(2)
    wi, wo = (from_spherical(np.arccos(rng.random(3000)), rng.uniform(0, 2 * np.pi, 3000)) for _ in range(2))
    order = neighbour_order(wi, wo)
    assert np.array_equal(np.sort(order), np.arange(3000))
    points = np.stack([*wi, *wo])
    steps = [np.median(np.linalg.norm(np.diff(points[:, o], axis=1), axis=0)) for o in (np.arange(3000), order)]
    # 3000 points in four dimensions are a seventh of the box apart, and the curve jumps now and then.
    assert steps[1] < 2 * steps[0] / 3000**0.25


def test_bits_are_spread_as_their_digits():
    level = np.random.default_rng(0).integers(0, 1 << 15, 50)
    for step in (2, 4):
        digits = [int(("0" * (step - 1)).join(f"{n:015b}"), 2) for n in level.tolist()]
        assert _spread(level.astype(np.uint64), step).tolist() == digits
