"""Figures of what transmits: both hemispheres are there, each value at its own place."""

import numpy as np
import pytest

from gonio.figures import diagnostics, readings, sampling
from gonio.figures.lobes import Curve, draw_in_plane, draw_polar
from gonio.figures.plots import draw_on


def test_curves_of_what_transmits_go_all_round_and_close_in_on_straight_through():
    angles = sampling.plane_angles(30.0, behind=True)
    front = angles[np.abs(angles) < 90]
    np.testing.assert_array_equal(front, sampling.plane_angles(30.0))
    assert (np.diff(angles) >= 0).all() and angles[0] < -179 and angles[-1] > 179
    assert np.isclose(angles, 150.0).any() and np.sum(np.abs(angles - 150) < 1) > 20  # 180° − θi
    np.testing.assert_allclose(np.sort(np.abs(angles[np.abs(angles) > 90])), np.sort(180 - np.abs(front)), atol=1e-12)


@pytest.mark.parametrize("draw", [draw_in_plane, draw_polar])
def test_the_axes_reach_behind_where_values_do(draw):
    angles = sampling.plane_angles(30.0, behind=True)
    curve = Curve(angles, np.where(np.abs(angles) < 90, 1.0, 2.0), "sheet", "k", theta_i=30.0)
    ax = draw_on(None, "sheet", draw, [curve], False)
    line = next(line for line in ax.lines if line.get_label() == "sheet")
    x, y = (np.asarray(a, float) for a in line.get_data())
    known = np.isfinite(y)
    assert np.sum(~known) == 2  # broken at the horizon
    if draw is draw_polar:
        assert ax.get_ylim()[0] < -1 and (np.sign(y[known]) == np.where(np.abs(angles[known]) < 90, 1, -1)).all()
        np.testing.assert_allclose(np.hypot(x, y)[known & (np.abs(angles) > 90)], 1.0)
    else:
        assert ax.get_xlim() == (-180, 180)


def test_readings_are_split_by_their_side():
    near = readings.Readings(np.array([10.0, 170.0, 100.0]), np.zeros(3), np.arange(3.0)[:, None], np.ones((3, 1)))
    (front, above), (behind, below) = near.by_side()
    assert not front and behind and above.f.tolist() == [[0.0]]
    assert below.theta_o.tolist() == [10.0, 80.0] and below.f.tolist() == [[1.0], [2.0]]


def test_residuals_behind_are_not_piled_up_at_the_horizon():
    theta = np.repeat([20.0, 160.0], 50)
    grid = diagnostics.median_grid(np.full(100, 40.0), theta, np.where(theta < 90, 0.1, -0.2), root=False)
    assert grid.y_edges[-1] == 180 and set(grid.median[np.isfinite(grid.median)].round(9)) == {10.0, -20.0}
    assert diagnostics.median_grid(theta[:9], theta[:9], np.ones(9), root=False).y_edges[-1] == 90
