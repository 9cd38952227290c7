"""Pairs of directions by the boxes of a grid, against interpolation pair by pair."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.interpolation.grid_boxes import GridBoxes, interpolation_axes
from gonio.data.interpolation.grid_coordinates import grid_coordinates
from gonio.data.interpolation.multilinear import as_material
from gonio.data.table import Channels, Table
from gonio.models.evaluation import evaluate
from gonio.models.geometry.directions import from_spherical

THETA, DELTA = np.radians(np.arange(0, 81, 10.0)), np.radians(np.arange(0, 360, 30.0))
GRIDS = {
    "isotropic": layouts.isotropic(THETA, THETA, DELTA),
    "spherical": layouts.spherical(THETA[::4], DELTA[::3], THETA, DELTA),
}


def directions(count, seed):
    u = np.random.default_rng(seed).random((4, count))
    return (from_spherical(1.35 * t, 2 * np.pi * p, np) for t, p in (u[:2], u[2:]))


@pytest.mark.parametrize("layout", GRIDS.values(), ids=GRIDS)
@pytest.mark.parametrize(("count", "gaps"), [(7, 0.0), (4000, 0.0), (4000, 0.2)])
def test_values_are_those_of_the_interpolant(layout, count, gaps):
    rng = np.random.default_rng(count)
    f = rng.random((layout.size, 2))
    valid = rng.random(layout.size) >= gaps
    flag = np.where(valid, Flag.VALID, Flag.NOT_MEASURED).astype(np.uint8)
    shape = (*layout.shape, 2)
    table = Table(layout, f.reshape(shape), np.repeat(flag, 2).reshape(shape), Channels(("a", "b")))
    wi, wo = directions(count, 1)
    expected = np.asarray(evaluate(as_material(table), wi, wo))
    x, _ = grid_coordinates(type(layout), wi, wo)
    boxes = GridBoxes.of(layout, interpolation_axes(layout), x).of_valid(valid)
    values = np.where(valid[:, None], f, 0.0)[boxes.cells]
    made = np.empty((count, 2))
    made[boxes.order] = boxes.interpolated(values)
    known = boxes.weight.sum(axis=0) > 0.5
    inside = np.zeros(count, bool)
    inside[boxes.order] = known
    np.testing.assert_allclose(made[inside], expected[inside], rtol=1e-10)
    assert inside.mean() > 0.9
    # What is summed is the transpose of what is interpolated.
    share = rng.standard_normal((count, 3))
    by_pair = share[boxes.order].T @ boxes.interpolated(values)
    np.testing.assert_allclose(np.einsum("kbm,kbc->mc", boxes.summed(share[boxes.order]), values), by_pair, rtol=1e-9)
    np.testing.assert_array_equal(np.sort(boxes.order), np.arange(count))
