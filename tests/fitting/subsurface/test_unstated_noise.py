"""The noise of readings that state none is told by their residuals: the share and the constant that made them."""

import numpy as np
import pytest

from gonio.fitting.subsurface.unstated_noise import likeliest_weights, relative_weights


@pytest.mark.parametrize("constant", [0.0, 1e-3, 0.3])
def test_the_constant_beside_the_share_is_found(constant):
    rng, model = np.random.default_rng(3), np.geomspace(1e-9, 1.0, 400)
    residual = 0.02 * np.hypot(model, constant) * rng.standard_normal(400)
    weight = likeliest_weights(model, residual, np.zeros(400), np.ones(400, bool))
    true = 1 / np.hypot(model, constant)
    assert np.abs(np.log(weight / true)).max() < 0.5


def test_no_reading_is_surer_than_the_negative_ones_show():
    y = np.array([1.0, 0.1, 1e-7, -0.02, 0.0])
    weight = relative_weights(y, np.array([True, True, True, True, False]))
    assert weight.tolist() == pytest.approx([1.0, 10.0, 50.0, 50.0, 0.0])
