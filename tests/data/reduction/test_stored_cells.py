"""Tables larger than memory: what is read of them cell by cell is what a whole reading gives."""

import math

import h5py
import numpy as np
import pytest

import gonio
from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.writer import write_table
from gonio.data.interpolation.coverage import covered
from gonio.data.interpolation.multilinear import as_material
from gonio.data.reduction import coarsest_table, stored_cells
from gonio.data.reduction.stored_cells import coarse_table, some_channels, with_stored_cells
from gonio.data.reduction.table_resolution import whole_grid
from gonio.data.reduction.thin_grid import interpolated
from gonio.data.scene import load_scene
from gonio.data.table import Table
from gonio.models.evaluation import evaluate_in_blocks
from support.marks import thorough

SCENE = load_scene("low_sun_car")


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """A table with holes and uncertainties; and the same in a file that is packed."""
    folder = tmp_path_factory.mktemp("stored")
    layout, rng = gonio.scan("isotropic", step=math.radians(10)), np.random.default_rng(1)
    f = 0.1 + np.cos(np.linspace(0, 6, layout.size * 2)).reshape(*layout.shape, 2) ** 2
    flag = np.where(rng.random(f.shape) < 0.1, 3, 0).astype(np.uint8)
    table = Table(layout, f, flag, gonio.data.Channels(("a", "b")), 0.01 * f, name="waves")
    write_table(folder / "t.h5", table)
    with h5py.File(folder / "t.h5") as whole, h5py.File(folder / "packed.h5", "w") as packed:
        packed.attrs.update(whole.attrs)
        for name, node in whole.items():
            options = {"chunks": node.shape, "compression": 1} if node.ndim > 1 else {}
            packed.create_dataset(name, data=node[...], **options).attrs.update(
                {k: v for k, v in node.attrs.items() if k not in ("DIMENSION_LIST", "REFERENCE_LIST")}
            )
            if node.is_scale:
                packed[name].make_scale(name)
    return folder / "t.h5", folder / "packed.h5"


def stored(path):
    return with_stored_cells(open_table(path, lazy_bytes=10, packed_bytes=10))


@pytest.mark.parametrize("which", [0, 1])
def test_cells_are_those_of_the_whole_array_wherever_they_lie(paths, which, monkeypatch):
    monkeypatch.setattr(stored_cells, "GATHERED", 37)
    table, whole = stored(paths[which]), open_table(paths[0])
    rng = np.random.default_rng(2)
    index = tuple(rng.integers(0, n, 500) for n in whole.layout.shape)
    for name in ("f", "u_f", "flag"):
        np.testing.assert_array_equal(getattr(table, name)[index], getattr(whole, name)[index])
    nodes = np.ix_(*(np.arange(0, n, 3) for n in whole.layout.shape))
    np.testing.assert_array_equal(table.f[nodes], whole.f[nodes])
    b = some_channels(table, ["b"])
    np.testing.assert_array_equal(b.f[index], whole.only(["b"]).f[index])
    assert b.shape == whole.only(["b"]).shape and b.channels == whole.only(["b"]).channels


def test_interpolation_and_coverage_are_those_of_the_whole_table(paths):
    table, whole, pairs = stored(paths[0]), open_table(paths[0]), SCENE.pairs(2000)
    expected = evaluate_in_blocks(as_material(whole), pairs.wi, pairs.wo)
    np.testing.assert_allclose(interpolated(whole_grid(table), pairs), expected, rtol=1e-6)
    np.testing.assert_array_equal(covered(table, pairs.wi, pairs.wo), covered(whole, pairs.wi, pairs.wo))


def test_coarse_tables_keep_the_ends_of_axes_and_their_periods(paths):
    table = stored(paths[0])
    coarse = coarse_table(table, 500)
    assert coarse.f.size <= 500 and isinstance(coarse.f, np.ndarray)
    for name, axis in coarse.layout.axes.items():
        whole = table.layout.axes[name]
        assert axis[0] == whole[0] and (axis[-1] == whole[-1] or table.layout.periods[name] is not None)
    assert coarse_table(table, 1 << 30).layout.shape == table.layout.shape


@pytest.mark.parametrize("named", [True, *thorough(False)])
def test_a_large_table_is_reduced_as_one_in_memory(tmp_path, monkeypatch, named):
    """Where the search begins from all nodes, the same nodes stay, and errors agree to the rounding of its corners."""
    for name, pairs in (("RANKING", 100), ("SEARCH", 400), ("CHECK", 1000)):
        monkeypatch.setattr(coarsest_table, name, pairs)
    path = tmp_path / "t.h5"
    material = "lambert(rho=[0.3, 0.2]) + ggx(alpha=0.4, f0=0.04)"
    gonio.measure(material, scan=gonio.scan("isotropic", step=math.radians(10)), output=path)
    tables = [open_table(path, lazy_bytes) for lazy_bytes in (1 << 40, 10)]
    if not named:
        for table in tables:
            table.provenance.pop("material")
    whole, large = (gonio.reduce(table, SCENE, tolerance=0.2) for table in tables)
    assert whole.cells == large.cells and whole.left_out == large.left_out
    np.testing.assert_array_equal(whole.table.f, large.table.f)
    numbers = ([r.error, r.promised, r.whole.error] for r in (whole, large))
    np.testing.assert_allclose(*numbers, rtol=1e-5)
