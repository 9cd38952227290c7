"""The inverse cube root against forty digits, over the whole range of numbers that a loss may meet."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np

from gonio.fitting.problem.cube_root import inverse_cube_root


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
