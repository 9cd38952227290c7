"""Losses: values, slopes, signs, and the behaviour at nothing."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.hdf5.reader import open_table
from gonio.data.table import whole_table_of_values
from gonio.fitting.problem.deferred_arrays import InverseWeights
from gonio.fitting.problem.readings import (
    LOSSES,
    floor_of,
    inverse_cube_root,
    loss_floor,
    readings_of,
    residual_weights,
    rows_of,
    sigma_of,
    transform,
    uses_cosine,
)


@pytest.mark.parametrize("loss", LOSSES)
def test_odd_smooth_and_rising(loss):
    v = np.linspace(-3, 3, 101)
    value, slope = transform(loss, v, 0.01, np)
    assert np.allclose(value, -value[::-1], atol=1e-15) and np.all(np.diff(value) > 0) and np.all(slope > 0)
    derivative = jax.vmap(jax.grad(lambda x: transform(loss, x, 0.01)[0]))(jnp.asarray(v[v != 0]))
    np.testing.assert_allclose(slope[v != 0], derivative, rtol=1e-9)


def test_cube_root_far_above_its_floor():
    value, _ = transform("cbrt", np.array([8.0, -27.0]), 1e-6, np)
    np.testing.assert_allclose(value, [2, -3], rtol=1e-9)


def test_logarithms():
    assert transform("log", np.array([np.e - 1]), 1.0, np)[0][0] == pytest.approx(1)
    assert [uses_cosine(loss) for loss in LOSSES] == [False, False, True, True, False]


def test_floor_follows_the_data():
    v = np.array([1.0, 2.0, 3.0, -4.0])
    assert floor_of("cbrt", v) == pytest.approx(0.01 * 2.5) and floor_of("log", v) == 1.0
    assert floor_of("cbrt", np.zeros(4)) == 1.0 and floor_of("cbrt", np.array([0.0, 0.0, 0.0, 5.0])) == pytest.approx(
        0.05
    )


def test_floor_is_the_noise_where_it_is_known():
    """Readings within their noise count evenly: the slope of the loss falls by no more than half up to there."""
    angles = np.radians([[60.0] * 50, [0.0] * 50, np.linspace(1, 80, 50), [180.0] * 50])
    layout = layouts.scattered(*angles)
    f = np.linspace(0.1, 1, 50)[:, None]
    unknown, known = (whole_table_of_values(layout, f, u_f=u) for u in (None, np.full_like(f, 0.02)))
    assert loss_floor(readings_of(known), "cbrt") == pytest.approx(0.02 * 0.5)
    assert loss_floor(readings_of(known), "log") == pytest.approx(0.02 * 0.5)
    assert loss_floor(readings_of(known), "log1p") == 1.0 == loss_floor(readings_of(unknown), "log")
    assert loss_floor(readings_of(unknown), "cbrt") == pytest.approx(0.01 * np.median(f * 0.5))
    for loss in ("cbrt", "log"):
        slope = transform(loss, np.array([0.0, 0.01]), 0.01, np)[1]
        assert 0.4 < slope[1] / slope[0] < 0.6


def test_log_with_a_floor_is_relative_far_above_it():
    value, _ = transform("log", np.array([1.0, 2.0]), 1e-9, np)
    assert value[1] - value[0] == pytest.approx(np.log(2), rel=1e-8)


def test_inverse_cube_root_is_right_to_rounding():
    s = np.concatenate([[1.0, 8.0, 1e-300, 1e300], 10 ** np.random.default_rng(0).uniform(-200, 200, 400)])
    with mpmath.workdps(40):
        truth = np.array([float(mpmath.cbrt(1 / mpmath.mpf(float(v)))) for v in s])
    np.testing.assert_allclose(inverse_cube_root(s), truth, rtol=4e-16)


def test_its_slope_and_other_precisions():
    slope = jax.vmap(jax.grad(inverse_cube_root))(jnp.array([0.3, 5.0, 2e-9]))
    np.testing.assert_allclose(slope, -(np.array([0.3, 5.0, 2e-9]) ** (-4 / 3)) / 3, rtol=1e-14)
    single = inverse_cube_root(jnp.asarray(8.0, jnp.float32))
    assert single.dtype == jnp.float32 and abs(float(single) - 0.5) < 1e-7


@pytest.mark.parametrize("known", [True, False])
def test_a_table_that_stays_in_its_file_gives_the_same_readings(tmp_path, known):
    grid = layouts.isotropic(np.radians([5.0, 40, 70]), np.radians([0.0, 30]), np.array([0.0, 1, 2]))
    rng = np.random.default_rng(4)
    f = rng.random((*grid.shape, 2)) + 0.1
    u_f = np.where(known | (rng.random(f.shape) < 0.5), 0.01 * f, np.nan)
    whole_table_of_values(grid, f, u_f=u_f).save(tmp_path / "t.h5")
    stored, whole = (readings_of(open_table(tmp_path / "t.h5", lazy_bytes=size)) for size in (0, 1 << 20))
    assert isinstance(stored.u_f, InverseWeights) == known
    some = np.array([3, 1])
    for mine, reference in ((stored, whole), (stored.part(some), whole.part(some))):
        parts = ((*r.wi, *r.wo, r.f, r.valid) for r in (mine, reference))
        assert all(np.array_equal(a, b) for a, b in zip(*parts, strict=True))
        np.testing.assert_allclose(mine.u_f, reference.u_f, rtol=1e-15)
    weights = [residual_weights(r, "sigma", sigma_of(r)) for r in (stored, whole)]
    np.testing.assert_allclose(*weights, rtol=1e-15)
    assert ((stored.u_f > 0) == (whole.u_f > 0)).all() and np.isfinite(stored.u_f).sum() == np.isfinite(whole.u_f).sum()


def test_what_one_number_stands_for_is_not_multiplied():
    same = np.broadcast_to(np.nan, (5, 3))
    assert rows_of(same, np.array([4, 0])).strides == (0, 0)
    assert rows_of(same, np.array([True, False, False, True, True])).shape == (3, 3)
    values = np.arange(15.0).reshape(5, 3)
    assert np.array_equal(rows_of(values, np.array([4, 0])), values[[4, 0]])
