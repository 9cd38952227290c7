"""What is written is read again, for every layout and every format that can be written."""

import json
import tempfile
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import Flag
from gonio.data.formats.registry import FORMATS, read, write
from gonio.data.layouts import LAYOUTS
from gonio.data.table import Table
from support.tables import assert_same

QUICK = settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
SUFFIXES = [known.suffixes[0] for known in FORMATS if known.write]
PRINTABLE = st.characters(codec="utf-8", exclude_categories=["Cc", "Cf", "Cs", "Zl", "Zp"])
PLAIN = st.none() | st.integers(-9, 9) | st.floats(allow_nan=False, width=32) | st.text(PRINTABLE, max_size=5)
PROVENANCE = st.dictionaries(st.text(PRINTABLE, max_size=5), PLAIN, max_size=3)
NAMES = st.text(PRINTABLE, max_size=8)


def axis(kind, size, increasing):
    below = kind.high if kind.period is None else kind.high - 1e-6
    return st.lists(st.floats(kind.low, below, width=64), min_size=size, max_size=size, unique=increasing).map(
        lambda angles: sorted(angles) if increasing else angles
    )


@st.composite
def grids(draw, kind):
    names = [k for k in kind.axis_kinds if k.name not in kind.optional_axes or draw(st.booleans())]
    if kind.gridded:
        return kind({k.name: draw(axis(k, draw(st.integers(1, 3)), True)) for k in names})
    size = draw(st.integers(1, 4))
    return kind({k.name: draw(axis(k, size, False)) for k in names})


@st.composite
def tables(draw, grid, count=None):
    grid = draw(grid)
    count = draw(st.integers(1, 4)) if count is None else count
    wavelengths = draw(st.none() | st.lists(st.floats(300, 2500), min_size=count, max_size=count).map(tuple))
    names = tuple(draw(st.lists(NAMES, min_size=count, max_size=count, unique=True)))
    rng, shape = np.random.default_rng(draw(st.integers(0, 2**32))), (*grid.shape, count)
    flag = rng.choice([int(Flag.VALID)] * 5 + [int(v) for v in Flag], shape).astype(np.uint8)
    flag[~grid.readable().reshape(grid.shape)] = Flag.BELOW_HORIZON
    dtype = draw(st.sampled_from([np.float32, np.float64]))
    f = np.where(flag == Flag.VALID, rng.lognormal(0, 10, shape) * rng.choice([-1, 1], shape), np.nan).astype(dtype)
    u_f = rng.choice([0.0, np.nan, 0.1], shape).astype(dtype) if draw(st.booleans()) else None
    table = Table(grid, f, flag, Channels(names, wavelengths), u_f, draw(PROVENANCE), draw(st.none() | st.just(1e-3)))
    table.name = draw(NAMES)
    return table


def written_and_read(table, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"t{suffix}")
        trip = write(path, table)
        return read(path), trip


@pytest.mark.parametrize("name", LAYOUTS)
@QUICK
@given(data=st.data())
def test_hdf5_keeps_everything(name, data):
    table = data.draw(tables(grids(LAYOUTS[name])))
    again, trip = written_and_read(table, ".h5")
    if table.u_f is not None and np.isnan(table.u_f).all():
        table.u_f = None
    assert_same(again, table)
    assert again.f.dtype == table.f.dtype and trip.max_absolute == 0 and trip.lost == 0
    assert json.loads(json.dumps(again.provenance)) == table.provenance


@pytest.mark.parametrize("name", LAYOUTS)
@QUICK
@given(data=st.data())
def test_csv_keeps_layout_and_readings(name, data):
    table = data.draw(tables(grids(LAYOUTS[name])).filter(lambda t: (t.flag == Flag.VALID).any()))
    again, trip = written_and_read(table, ".csv")
    values, angles, above = table.read_values(), np.array(table.layout.angles()), table.layout.readable()
    if table.layout.gridded:
        assert again.layout == table.layout and not (again.flag[~above.reshape(table.layout.shape)] == Flag.VALID).any()
        read_values = again.values_at(np.flatnonzero(above))
    else:
        # Of a list, what is flagged below the horizon and lies behind is what a warp has left there.
        above = above & ~((values["flag"] == Flag.BELOW_HORIZON).all(axis=1) & (angles[[0, 2]] > np.pi / 2).any(axis=0))
        np.testing.assert_array_max_ulp(np.array(again.layout.angles()), angles[:, above], maxulp=1)
        read_values = again.read_values()
    assert again.channels == table.channels
    np.testing.assert_array_equal(read_values["flag"], values["flag"][above])
    np.testing.assert_array_equal(read_values["f"], values["f"][above])
    if table.u_f is not None:
        np.testing.assert_array_equal(read_values["u_f"], values["u_f"][above])
    assert trip.max_absolute == 0 and trip.lost == 0 and trip.compared == np.sum(values["flag"] == Flag.VALID)
    assert trip.note == ("" if above.all() else f"{np.sum(~above)} cells below the horizon left out")


@QUICK
@given(data=st.data())
def test_merl_keeps_what_is_not_negative(data):
    counts = tuple(data.draw(st.lists(st.integers(1, 4), min_size=3, max_size=3)))
    table = data.draw(tables(st.just(layouts.merl(counts=counts)), data.draw(st.sampled_from([1, 3]))))
    again, trip = written_and_read(table, ".binary")
    wavelengths = table.channels.wavelengths_nm  # the longest is red
    order = np.arange(table.f.shape[-1]) if wavelengths is None else np.argsort(wavelengths)[::-1]
    f, flag = (np.broadcast_to(a[..., order], again.f.shape) for a in (table.f, table.flag))
    kept = (flag == Flag.VALID) & (f >= 0)
    assert again.layout == table.layout and again.channels == Channels.rgb()
    np.testing.assert_array_equal(again.flag == Flag.VALID, kept)
    np.testing.assert_allclose(again.f[kept], f[kept], rtol=4e-16)  # one division and one product
    assert trip.lost == np.sum((flag == Flag.VALID) & (f < 0)) and trip.compared == kept.sum()


def test_every_format_that_is_written_is_tried_here():
    # What the files of others keep: test_rgl_write.py, test_optics_written.py, and test_{astm,bird,ssdd,utia}.py
    written = {".h5", ".csv", ".binary", ".bsdf", ".anisotropicbsdf", ".xml", ".astm", ".json", ".ssdd", ".bin"}
    assert set(SUFFIXES) == written
