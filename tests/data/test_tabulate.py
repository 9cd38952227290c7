"""Models on the cells of grids whose axes tell half vectors."""

import jax
import numpy as np

from gonio.data import layouts
from gonio.data.tabulate import grid_values
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build
from gonio.models.geometry.half_vector import half_angles, stated_half_angles
from gonio.stability.precision import cast

NARROW = "ggx(alpha=0.003, f0=0.04)"


def test_the_half_angles_of_a_grid_are_those_of_its_directions():
    grid = layouts.half_difference(
        np.linspace(0, 1.2, 4), np.linspace(0, 1.5, 3), np.linspace(0, 3, 5), [0.0, 2.0, 4.0]
    )
    by_axes = grid.half_angles([(np.cos(a), np.sin(a)) for a in np.ix_(*grid.axes.values())])
    wi, wo = grid.directions()
    for stated, computed in zip(jax.tree.leaves(by_axes), jax.tree.leaves(jax.jit(half_angles)(wi, wo)), strict=True):
        np.testing.assert_allclose(np.broadcast_to(stated, grid.shape).reshape(-1), computed, atol=1e-15)
    elsewhere = wo, wi._replace(z=wi.z * 1)
    with stated_half_angles(wi, wo, by_axes):
        assert half_angles(wo, wi) is by_axes
        assert jax.eval_shape(lambda: half_angles(*elsewhere)).cos_d.shape == wi.x.shape


def test_narrow_lobes_on_a_grid_keep_their_digits_in_single_precision():
    """The half vector of two directions in single precision is known to 1e-7, a lobe of 0.003 then to 1e-3."""
    grid = layouts.half_difference(np.linspace(0, 0.02, 16), [0.2, 0.7], np.linspace(0, 3, 16))
    exact = grid_values(build(NARROW), grid)
    brdf = cast(build(NARROW), np.float32)
    with jax.enable_x64(False):
        stated = np.asarray(grid_values(brdf, grid))
        summed = np.asarray(evaluate(brdf, *grid.directions())).reshape(stated.shape)
    assert np.max(np.abs(stated / exact - 1)) < 4e-6 < np.max(np.abs(summed / exact - 1))


def test_xla_computes_the_same_cells(monkeypatch):
    grid = layouts.half_difference(np.linspace(0, 1.5, 4), [0.1, 0.9], np.linspace(0, 3, 16))
    loops = grid_values(build(NARROW), grid)
    monkeypatch.setenv("GONIO_EVALUATE_WITH", "xla")
    np.testing.assert_allclose(grid_values(build(NARROW), grid), loops, rtol=1e-13)
