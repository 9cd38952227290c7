"""The table: any range of its cells, counts and samples against plain NumPy on the whole arrays."""

import copy
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gonio.data import layouts
from gonio.data.cell_ranges import boxes
from gonio.data.flags import Flag
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.models.errors import GonioError

GRID = layouts.isotropic(np.radians([0, 30, 60, 85]), np.radians([0, 40, 88]), np.radians([0, 90, 180, 270]))


def random_table(seed=0):
    rng = np.random.default_rng(seed)
    shape = (*GRID.shape, 2)
    flag = rng.choice(len(Flag), shape, p=[0.6, 0.1, 0.1, 0.1, 0.05, 0.05]).astype(np.uint8)
    return Table(GRID, rng.standard_normal(shape), flag, Channels(("a", "b")), rng.random(shape))


@given(
    shape=st.lists(st.integers(1, 5), min_size=1, max_size=4),
    ends=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_boxes_cover_a_range_in_order(shape, ends):
    x = np.arange(np.prod(shape)).reshape(shape)
    start, stop = sorted(round(e * x.size) for e in ends)
    if start < stop:
        parts = [x[box].ravel() for box in boxes(tuple(shape), start, stop)]
        np.testing.assert_array_equal(np.concatenate(parts), np.arange(start, stop))
        assert len(parts) <= 2 * len(shape)


@pytest.mark.parametrize("max_cells", [1, 5, 12, 30, 1000])
def test_blocks_cover_all_cells_once(max_cells):
    table = random_table()
    ranges = list(table.blocks(max_cells))
    assert ranges[0][0] == 0 and ranges[-1][1] == GRID.size
    assert all(stop == start for (_, stop), (start, _) in itertools.pairwise(ranges))
    assert all(stop - start <= max_cells for start, stop in ranges)
    np.testing.assert_array_equal(np.concatenate([table.read(*r).f for r in ranges]), table.f.reshape(-1, 2))


def test_counts_are_those_of_the_arrays():
    table = random_table()
    counts = table.counts()
    assert counts["cells"] == GRID.size
    assert counts["negative"] == np.sum((table.f < 0) & (table.flag == 0)) > 0
    for flag in Flag:
        assert counts[flag.name.lower()] == np.sum(table.flag == flag)


def test_samples_are_the_valid_cells_and_a_draw_of_them_is_fair():
    table = random_table()
    cos_i, cos_o = GRID.cosines()
    usable = (table.flag.reshape(-1, 2) == Flag.VALID).any(1)
    inner = usable & (np.maximum(np.arccos(cos_i), np.arccos(cos_o)) < np.radians(80))
    np.testing.assert_array_equal(table.samples().f, table.f.reshape(-1, 2)[usable])
    part = table.samples(theta_max=np.radians(80))
    np.testing.assert_array_equal(part.f, table.f.reshape(-1, 2)[inner])
    np.testing.assert_array_equal(part.u_f, table.u_f.reshape(-1, 2)[inner])
    np.testing.assert_array_equal(part.flag, table.flag.reshape(-1, 2)[inner])
    np.testing.assert_allclose(part.wo.z, cos_o[inner], atol=1e-15)
    draws = [table.samples(5, seed=seed) for seed in range(400)]
    assert all(len(set(d.f[:, 0])) == 5 for d in draws)
    np.testing.assert_array_equal(table.samples(5, seed=3).f, draws[3].f)
    hits = sum(np.isin(table.f.reshape(-1, 2)[usable][:, 0], d.f[:, 0]) for d in draws)
    share = 5 / usable.sum()
    assert np.abs(hits - 400 * share).max() < 5 * np.sqrt(400 * share * (1 - share))


def test_unknown_uncertainty_reads_as_nan_and_an_empty_table_has_no_samples():
    table = whole_table_of_values(GRID, np.full(GRID.shape, np.nan))
    assert np.isnan(table.read(3, 7).u_f).all()
    empty = table.samples()
    assert empty.f.shape == empty.u_f.shape == (0, 1) and empty.wi.x.shape == (0,)


def test_bare_values_are_flagged_by_the_geometry_and_their_worth():
    grid = layouts.in_plane([0.3], [0.0, 0.5, np.pi / 2])
    table = whole_table_of_values(grid, np.array([[-0.1, np.inf, 4.0]]))
    assert table.flag.ravel().tolist() == [Flag.VALID, Flag.INVALID, Flag.BELOW_HORIZON]
    np.testing.assert_array_equal(table.f.ravel(), [-0.1, np.nan, np.nan])
    assert table.counts()["negative"] == 1


def test_shapes_and_channels_that_disagree_are_refused():
    f = np.zeros((*GRID.shape, 2))
    with pytest.raises(GonioError, match="flag has shape"):
        Table(GRID, f, f[:2], Channels(("a", "b")))
    with pytest.raises(GonioError, match="f has shape"):
        Table(GRID, f, f, Channels.rgb())
    with pytest.raises(GonioError, match="2 channels have 1 wavelengths"):
        Channels(("a", "b"), (500.0,))
    with pytest.raises(GonioError, match="no channel"):
        Channels(())
    assert Channels.of_wavelengths([632.8]).names == ("632.8 nm",)
    assert [len(Channels.of_count(n)) for n in (1, 2, 3, 7)] == [1, 2, 3, 7]


def test_channels_alone():
    f = np.arange(12.0).reshape(2, 2, 3)
    whole = whole_table_of_values(
        layouts.in_plane([0.1, 0.2], [-0.3, 0.3]), f, Channels.of_wavelengths([450, 550, 650])
    )
    part = whole.only(["650 nm", "450 nm"])
    assert part.channels.wavelengths_nm == (650.0, 450.0) and np.array_equal(part.f, whole.f[..., [2, 0]])
    with pytest.raises(GonioError, match="'550 nm'"):
        whole.only(["555 nm"])


@pytest.mark.parametrize(
    ("u_f", "words"), [(None, "not stated"), (0.0, "exact, no noise"), (np.nan, "unknown"), (0.1, "median 0.1 1/sr")]
)
def test_a_table_shows_what_is_known_of_its_uncertainties(u_f, words):
    grid = layouts.isotropic([0.1], [0.2, 0.3], [0.0])
    uncertainty = None if u_f is None else np.full((*grid.shape, 1), u_f)
    assert words in repr(whole_table_of_values(grid, np.ones(grid.shape), u_f=uncertainty))


def test_comparing_tables_has_one_answer():
    table = random_table()
    assert table == table and table != copy.deepcopy(table) and table in [copy.deepcopy(table), table]
