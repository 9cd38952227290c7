"""The relative exponential against SciPy's, with its slope."""

import jax
import numpy as np
from scipy import special

from gonio.models.special.exprel import exprel


def test_it_and_its_slope_are_those_of_the_function_everywhere():
    x = np.concatenate([s * np.logspace(-12, 2, 57) for s in (-1, 1)] + [[0.0]])
    value, slope = jax.vmap(jax.value_and_grad(exprel))(x)
    np.testing.assert_allclose(value, special.exprel(x), rtol=1e-14)
    # (eˣ(x − 1) + 1)/x² loses its digits towards 0, where the slope is 1/2 + x/3.
    near = np.abs(x) < 1e-2
    far = x[~near]
    np.testing.assert_allclose(slope[~near], (np.exp(far) * (far - 1) + 1) / far**2, rtol=1e-11)
    np.testing.assert_allclose(slope[near], 0.5 + x[near] / 3 + x[near] ** 2 / 8, atol=1e-6)
