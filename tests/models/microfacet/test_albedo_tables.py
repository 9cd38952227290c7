"""Tabulated albedos have whole slopes up to the bounds of their axes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gonio.models.microfacet.albedo_tables import coat_series, tabulated, width_series


def test_tables_have_their_whole_slope_on_a_bound():
    """Slopes by width and index on their bounds, beside those a little inside."""

    def albedo(alpha, eta):
        return tabulated("coat", coat_series(alpha, eta), jnp.asarray(0.3), alpha)

    alpha = np.array([[1.0, 1.0 - 1e-6], [1e-4, 1e-4 + 1e-10], [0.1, 0.1], [0.1, 0.1]])
    eta = np.array([[1.5, 1.5], [1.5, 1.5], [1.01, 1.01 + 1e-8], [4.0, 4.0 - 1e-6]])
    by_alpha, by_eta = jax.jit(jax.vmap(jax.grad(albedo, (0, 1))))(alpha.ravel(), eta.ravel())
    slopes = np.concatenate([np.asarray(by_alpha).reshape(4, 2)[:2], np.asarray(by_eta).reshape(4, 2)[2:]])
    assert slopes[:, 0] == pytest.approx(slopes[:, 1], rel=1e-3) and np.all(slopes != 0)


@pytest.mark.parametrize("name, slope", [("kelemen_white", 2e-4), ("kelemen_grazing", -2e-4)])
def test_slopes_by_the_width_hold_where_a_lobe_is_a_mirror(name, slope):
    """Of light along the normal narrow Kelemen lobes miss α² of 1, and those of F = (1 − d)⁵ too: slopes of ±2α."""

    def missing(alpha):
        return tabulated(name, width_series(name, alpha), jnp.asarray(1.0), alpha)

    # What is left is the rounding of the coefficients to 1e-11.
    assert jax.grad(missing)(jnp.asarray(1e-4)) == pytest.approx(slope, abs=5e-5)
