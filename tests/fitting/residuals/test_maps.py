"""Maps of relative residuals over two angles."""

import numpy as np

from gonio.fitting.residuals.maps import residual_map
from gonio.fitting.residuals.pair_angles import PairAngles


def test_a_map_holds_medians_and_counts():
    theta_i, theta_o = np.array([15.0, 15.0, 15.0, 55.0]), np.array([25.0, 25.0, 25.0, 90.0])
    angles = PairAngles(theta_i, theta_o, theta_i, theta_o)
    relative = np.array([[0.1], [0.2], [0.9], [-0.5]])
    m = residual_map(angles, relative, np.ones((4, 1), bool), ("theta_i", "theta_o"))
    assert m.median_relative[1, 2] == 0.2 and m.count[1, 2] == 3 and m.median_relative[5, 8] == -0.5
    assert np.isnan(m.median_relative[0, 0]) and m.count.sum() == 4 and m.region(1, 2) == "θi 10–20°, θo 20–30°"
    assert m.to_dict()["count"][5][8] == 1
