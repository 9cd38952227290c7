"""Values of subgrids, which keep what a trial does not change: those of a table of these nodes, in any order."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.interpolation.multilinear import as_material
from gonio.data.reduction.subgrid_values import SubgridValues
from gonio.data.table import Channels, Table
from gonio.models.evaluation import evaluate_in_blocks
from gonio.models.geometry.directions import Direction

EVEN = np.linspace(0, 1.5, 9)
GRIDS = {
    "isotropic": layouts.isotropic(EVEN, EVEN, np.linspace(0, 2 * np.pi, 12, endpoint=False)),
    "mirrored": layouts.isotropic(EVEN[::2], EVEN**2 / 1.5, np.linspace(0, np.pi, 7)),
    "spherical": layouts.spherical(EVEN, np.array([0.0, 1.0, 2.5]), EVEN, np.arange(0, 6, 0.7)),
    "half-difference": layouts.half_difference(EVEN**2 / 1.5, EVEN, np.linspace(0, np.pi, 5, endpoint=False)),
}


def directions(rng, n):
    z, phi = 0.05 + 0.95 * rng.random(n), 2 * np.pi * rng.random(n)
    s = np.sqrt(1 - z**2)
    return Direction(s * np.cos(phi), s * np.sin(phi), z)


def some_nodes(rng, kept):
    """A step of a search from the nodes of each axis: some of one axis gone, or back again."""
    k = int(rng.integers(len(kept)))
    size = kept[k][-1] + 1
    nodes = np.sort(rng.choice(size, int(rng.integers(1, size + 1)), replace=False))
    if rng.random() < 0.7 and kept[k].size > 1:
        nodes = np.delete(kept[k], rng.integers(kept[k].size))
    return (*kept[:k], nodes, *kept[k + 1 :])


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("one_for_all", [False, True])
def test_subgrids_asked_one_after_another_have_the_bits_of_each_asked_alone(name, one_for_all):
    layout, rng = GRIDS[name], np.random.default_rng(len(name))
    f = rng.random((*layout.shape, 2))
    valid = rng.random(f.shape) < 0.9
    valid = np.broadcast_to(valid[..., :1], f.shape) if one_for_all else valid
    wi, wo = directions(rng, 60), directions(rng, 60)
    values, kept = SubgridValues(layout, f, valid, wi, wo), tuple(np.arange(n) for n in layout.shape)
    for _ in range(40):
        alone = SubgridValues(layout, f, valid, wi, wo).of(kept)
        np.testing.assert_array_equal(values.of(kept), alone)
        kept = some_nodes(rng, kept)
    index = np.ix_(*kept)
    part = layout.part(**dict(zip(layout.axes, kept, strict=True)))
    flag = np.where(valid[index], 0, 3).astype(np.uint8)
    table = Table(part, f[index].astype(np.float32), flag, Channels(("a", "b")))
    if (flag == 0).any():
        np.testing.assert_allclose(values.of(kept), evaluate_in_blocks(as_material(table), wi, wo), rtol=1e-5)
