"""The HDF5 file: what is written is what is read, by gonio and by xarray; kills, strangers and full disks."""

import errno
import os
import random
import signal
import subprocess
import sys
import textwrap
import time

import h5py
import numpy as np
import pytest
import xarray

from gonio.data import block_writer, hdf5_reading, layout
from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.store import BlockWriter, open_table, write_table
from gonio.data.table import Channels, Table, whole_table_of_values
from gonio.models.errors import GonioError

LAYOUTS = {
    "spherical": layout.spherical([0.1, 0.5], [0, 1, 2], [0.2, 0.4], [0.0, 3.0]),
    "isotropic": layout.isotropic([0.1, 0.5], [0.2, 0.4, 1.2], [0.0, 1.5, 3.0]),
    "half_difference": layout.merl(counts=(4, 5, 6)),
    "anisotropic half_difference": layout.half_difference([0, 0.3], [0.1, 0.5], [0, 1], [0, 2, 4]),
    "in_plane": layout.in_plane([0.1, 0.5], [-0.4, 0.0, 0.2]),
    "scattered": layout.scattered([0.1, 0.5, 0.2], [0, 1, 2], [0.3, 0.3, 0.3], [3, 2, 1]),
}
PROVENANCE = {"material": "lambert(rho=0.5)", "seed": 7, "größe": [1.5, None, "µ"]}


def random_table(grid, dtype=np.float64, u_f="stored", seed=0):
    rng = np.random.default_rng(seed)
    shape = (*grid.shape, 3)
    flag = rng.integers(0, len(Flag), shape).astype(np.uint8)
    f = np.where(flag == 0, rng.standard_normal(shape), np.nan).astype(dtype)
    values = {"stored": rng.random(shape).astype(dtype), "exact": np.zeros(shape, dtype), "unknown": None}[u_f]
    channels = Channels(("a", "b", "µ"), (450.0, 550.5, 632.8))
    return Table(grid, f, flag, channels, values, PROVENANCE, 1e-3, None, "a name")


def assert_same(a: Table, b: Table):
    assert a.layout == b.layout and a.channels == b.channels and a.provenance == b.provenance and a.name == b.name
    assert (a.source_solid_angle, a.receiver_solid_angle) == (b.source_solid_angle, b.receiver_solid_angle)
    np.testing.assert_array_equal(a.f[...], b.f[...])
    np.testing.assert_array_equal(a.flag[...], b.flag[...])
    assert (a.u_f is None) == (b.u_f is None)
    if a.u_f is not None:
        np.testing.assert_array_equal(a.u_f[...], b.u_f[...])


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_written_table_is_read_back_the_same(tmp_path, name):
    table = random_table(LAYOUTS[name])
    write_table(tmp_path / "t.h5", table)
    assert_same(open_table(tmp_path / "t.h5"), table)
    assert_same(open_table(tmp_path / "t.h5", lazy_bytes=0), table)
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]


@pytest.mark.parametrize("u_f", ["exact", "unknown"])
def test_a_constant_uncertainty_takes_no_room(tmp_path, u_f):
    table = random_table(layout.merl(counts=(20, 20, 20)), np.float32, u_f)
    write_table(tmp_path / "t.h5", table)
    assert_same(open_table(tmp_path / "t.h5"), table)
    assert (tmp_path / "t.h5").stat().st_size < table.f.nbytes + table.flag.nbytes + 20_000


def test_a_lazy_table_reads_any_range(tmp_path):
    table = random_table(LAYOUTS["half_difference"])
    write_table(tmp_path / "t.h5", table)
    lazy = open_table(tmp_path / "t.h5", lazy_bytes=0)
    assert isinstance(lazy.f, h5py.Dataset)
    for start, stop in [(0, 120), (3, 5), (7, 100), (29, 31), (119, 120)]:
        for mine, other in zip(lazy.read(start, stop), table.read(start, stop), strict=True):
            np.testing.assert_array_equal(mine, other)
    assert lazy.counts() == table.counts()
    np.testing.assert_array_equal(lazy.samples(20).f, table.samples(20).f)


def test_xarray_opens_it_with_named_axes_units_and_flags(tmp_path):
    for name in ("isotropic", "half_difference", "scattered"):
        table = random_table(LAYOUTS[name])
        write_table(tmp_path / f"{name}.h5", table)
        with xarray.open_dataset(tmp_path / f"{name}.h5", engine="h5netcdf") as data:
            assert data.f.dims == (*table.layout.dims, "channel")
            np.testing.assert_array_equal(data.f.values, table.f)
            np.testing.assert_array_equal(data.u_f.values, table.u_f)
            for axis, values in table.layout.axes.items():
                np.testing.assert_array_equal(data.coords[axis].values, values)
                assert data[axis].attrs["units"] == "radian" and data[axis].attrs["long_name"]
            assert data.f.attrs["units"] == data.u_f.attrs["units"] == "sr-1"
            assert list(data.channel.values) == ["a", "b", "µ"]
            assert list(data.wavelength.values) == [450.0, 550.5, 632.8]
            assert tuple(data.flag.attrs["flag_meanings"].split()) == FLAG_MEANINGS
            assert list(data.flag.attrs["flag_values"]) == [int(v) for v in Flag]
            assert data.attrs["gonio_format"] == 1 and data.attrs["layout"] == name


def test_it_can_be_saved_again_by_xarray_and_read(tmp_path):
    table = random_table(LAYOUTS["isotropic"])
    write_table(tmp_path / "t.h5", table)
    with xarray.open_dataset(tmp_path / "t.h5", engine="h5netcdf") as data:
        packed = {name: {"zlib": True, "complevel": 4} for name in ("f", "u_f", "flag")}
        data.to_netcdf(tmp_path / "again.nc", engine="h5netcdf", encoding=packed)
    assert_same(open_table(tmp_path / "again.nc"), table)


def damaged(tmp_path, change):
    write_table(tmp_path / "t.h5", random_table(LAYOUTS["isotropic"]))
    with h5py.File(tmp_path / "t.h5", "r+") as file:
        change(file)
    return tmp_path / "t.h5"


def replace_f(file, **options):
    del file["f"]
    file.create_dataset("f", **options)


STRANGERS = {
    "gonio_format 7": lambda file: file.attrs.__setitem__("gonio_format", 7),
    "no table of gonio": lambda file: file.attrs.__delitem__("gonio_format"),
    "layout 'round'": lambda file: file.attrs.__setitem__("layout", "round"),
    "variable u_f is missing": lambda file: file.__delitem__("u_f"),
    "units 'grad'": lambda file: file["theta_i"].attrs.__setitem__("units", "grad"),
    "provenance is no JSON": lambda file: file.attrs.__setitem__("provenance", "{"),
    "names 2 channels": lambda file: file.attrs.__setitem__("channel_names", '["a", "b"]'),
    "not strictly increasing": lambda file: file["theta_o"].__setitem__(1, 0.2),
    "outside": lambda file: file["theta_o"].__setitem__(2, np.nan),
    "expected numbers": lambda file: replace_f(file, data=["a"], dtype=h5py.string_dtype()),
    "has shape": lambda file: replace_f(file, data=np.zeros((2, 3, 4, 3))),
    "hold no values": lambda file: replace_f(file, shape=(2, 3, 3, 3), dtype="f8", chunks=(1, 3, 3, 3)),
    "more than the file can hold": lambda file: (
        replace_f(file, shape=(1 << 40, 3), dtype="f8", chunks=(4, 3)) or file["f"].__setitem__((0, 0), 1.0)
    ),
    "not stored in the file itself": lambda file: (
        file.__delitem__("f") or file.__setitem__("f", h5py.ExternalLink("x", "/f"))
    ),
}


@pytest.mark.parametrize("said", STRANGERS)
def test_a_strangers_file_is_refused_with_its_name_and_the_reason(tmp_path, said):
    path = damaged(tmp_path, STRANGERS[said])
    with pytest.raises(GonioError, match=said) as error:
        open_table(path)
    assert "t.h5" in str(error.value) or "layout" in str(error.value)


def test_a_virtual_dataset_may_not_reach_another_file(tmp_path):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["f"] = np.ones((2, 3, 3, 3))
    source = h5py.VirtualLayout(shape=(2, 3, 3, 3), dtype="f8")
    source[...] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "f", shape=(2, 3, 3, 3))
    path = damaged(tmp_path, lambda file: (file.__delitem__("f"), file.create_virtual_dataset("f", source)))
    with pytest.raises(GonioError, match="not stored in the file itself"):
        open_table(path)


def test_a_truncated_or_foreign_file_is_refused_at_any_length(tmp_path):
    write_table(tmp_path / "t.h5", random_table(LAYOUTS["isotropic"]))
    whole = (tmp_path / "t.h5").read_bytes()
    for length in (1, 8, 100, 1000, len(whole) // 2, len(whole) - 1):
        (tmp_path / "cut.h5").write_bytes(whole[:length])
        with pytest.raises(GonioError, match=r"cut\.h5"):
            open_table(tmp_path / "cut.h5")
    for content, said in ((b"", "is empty"), (b"PNG and so on", "is not a whole HDF5 file")):
        (tmp_path / "cut.h5").write_bytes(content)
        with pytest.raises(GonioError, match=said):
            open_table(tmp_path / "cut.h5")
    with pytest.raises(GonioError, match="does not exist"):
        open_table(tmp_path / "none.h5")


def test_flipped_bytes_never_raise_anything_but_a_gonio_error(tmp_path):
    write_table(tmp_path / "t.h5", random_table(LAYOUTS["in_plane"]))
    whole = bytearray((tmp_path / "t.h5").read_bytes())
    rng = random.Random(0)
    for _ in range(150):
        hurt = bytearray(whole)
        for _ in range(3):
            hurt[rng.randrange(len(hurt))] = rng.randrange(256)
        (tmp_path / "hurt.h5").write_bytes(hurt)
        try:
            open_table(tmp_path / "hurt.h5")
        except GonioError as error:
            assert "\n" not in str(error)


def test_opening_does_not_touch_the_file(tmp_path):
    write_table(tmp_path / "t.h5", random_table(LAYOUTS["in_plane"]))
    os.chmod(tmp_path / "t.h5", 0o444)
    before = (tmp_path / "t.h5").read_bytes()
    open_table(tmp_path / "t.h5", lazy_bytes=0).counts()
    assert (tmp_path / "t.h5").read_bytes() == before


def test_nothing_is_overwritten_or_left_behind(tmp_path, monkeypatch):
    table = random_table(LAYOUTS["in_plane"])
    write_table(tmp_path / "t.h5", table)
    with pytest.raises(GonioError, match="--force"):
        write_table(tmp_path / "t.h5", table)
    write_table(tmp_path / "t.h5", table, force=True)
    with pytest.raises(GonioError, match="does not exist; make it first"):
        write_table(tmp_path / "none" / "t.h5", table)
    with pytest.raises(GonioError, match="is a folder"):
        write_table(tmp_path, table)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(GonioError, match="no room on the disk"):
        BlockWriter(tmp_path / "u.h5", table.layout, table.channels)
    monkeypatch.setattr("gonio.data.store.write_all", full)
    with pytest.raises(GonioError, match="no room on the disk"):
        write_table(tmp_path / "u.h5", table)
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]


def writer(path, table, **options):
    given = {"recipe": {"seed": 7}, "provenance": PROVENANCE, "name": "a name", "block_cells": 11} | options
    return BlockWriter(path, table.layout, table.channels, table.f.dtype, source_solid_angle=1e-3, **given)


def fill(blocks, table):
    for k in blocks.missing_blocks():
        values = table.read_values(*blocks.blocks[k])
        blocks.write(k, values["f"], values["u_f"], values["flag"])


def test_blocks_make_the_same_file_as_the_whole(tmp_path):
    table = random_table(LAYOUTS["half_difference"])
    with writer(tmp_path / "t.h5", table) as blocks:
        for k in reversed(blocks.missing_blocks()):
            values = table.read_values(*blocks.blocks[k])
            blocks.write(k, values["f"], values["u_f"], values["flag"])
        blocks.finish()
    assert_same(open_table(tmp_path / "t.h5"), table)
    write_table(tmp_path / "w.h5", table)
    assert (tmp_path / "t.h5").read_bytes() == (tmp_path / "w.h5").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["t.h5", "w.h5"]


def test_a_stopped_writer_is_continued_and_another_recipe_refused(tmp_path):
    table, path = random_table(LAYOUTS["half_difference"]), tmp_path / "t.h5"
    with writer(path, table) as blocks:
        first = table.read_values(*blocks.blocks[3])
        blocks.write(3, first["f"], first["u_f"], first["flag"])
        with pytest.raises(ValueError, match="not written yet"):
            blocks.finish()
        with pytest.raises(GonioError, match="another process"):
            writer(path, table)
    for other in ({"recipe": {"seed": 8}}, {"u_f": False}, {"block_cells": 12}):
        with pytest.raises(GonioError, match="another recipe"):
            writer(path, table, **other)
    with writer(path, table, provenance={"created": "later"}) as blocks:
        assert 3 not in blocks.missing_blocks() and len(blocks.missing_blocks()) == len(blocks.blocks) - 1
        fill(blocks, table)
        blocks.finish()
    assert_same(open_table(path), table)
    with pytest.raises(GonioError, match="exists already"):
        writer(path, table)
    with writer(path, table, force=True) as blocks:
        assert len(blocks.missing_blocks()) == len(blocks.blocks)
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]


def test_a_damaged_part_is_begun_anew_and_a_lost_block_written_again(tmp_path):
    table, path = random_table(LAYOUTS["half_difference"]), tmp_path / "t.h5"
    part = tmp_path / "t.h5.part"
    with writer(path, table) as blocks:
        fill(blocks, table)
        offset, _ = blocks._places.of("f")
    with part.open("r+b") as file:
        file.seek(offset + 11 * 3 * 8 * 2 + 5)
        file.write(b"\x55\x55")
    with writer(path, table) as blocks:
        assert blocks.missing_blocks() == [2]
    whole = part.read_bytes()
    for length in (0, 100, len(whole) // 2, len(whole) - 1):
        part.write_bytes(whole[:length])
        with writer(path, table) as blocks:
            assert len(blocks.missing_blocks()) == len(blocks.blocks)


def test_an_ideal_instruments_uncertainty_is_not_stored(tmp_path):
    table = random_table(LAYOUTS["half_difference"], u_f="exact")
    with writer(tmp_path / "t.h5", table, u_f=False) as blocks:
        fill(blocks, table)
        blocks.finish()
    assert_same(open_table(tmp_path / "t.h5"), table)


KILLED = """
    import sys, time
    import numpy as np
    from gonio.data import layout
    from gonio.data.store import BlockWriter
    from gonio.data.table import Channels

    grid = layout.merl(counts=(30, 30, 60))
    with BlockWriter(sys.argv[1], grid, Channels.rgb(), recipe={"seed": 1}, block_cells=1800) as blocks:
        print("ready", flush=True)
        for k in blocks.missing_blocks():
            start, stop = blocks.blocks[k]
            f = np.random.default_rng(k).random((stop - start, 3))
            blocks.write(k, f, 0.1 * f, np.zeros(f.shape, np.uint8))
            time.sleep(0.01)
        blocks.finish()
"""


def test_a_killed_writer_goes_on_to_the_same_values(tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(textwrap.dedent(KILLED))
    path, calm = tmp_path / "t.h5", tmp_path / "calm.h5"
    rng = random.Random(1)
    for _ in range(4):
        process = subprocess.Popen([sys.executable, script, path], stdout=subprocess.PIPE, cwd=tmp_path)
        process.stdout.readline()
        time.sleep(rng.uniform(0.0, 0.15))
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    for target in (path, calm):
        subprocess.run([sys.executable, script, target], check=True, cwd=tmp_path, stdout=subprocess.DEVNULL)
    assert path.read_bytes() == calm.read_bytes()
    assert not (tmp_path / "t.h5.part").exists()


def test_the_modules_agree_on_what_a_bare_table_is(tmp_path):
    table = whole_table_of_values(LAYOUTS["in_plane"], np.ones((2, 3)), receiver_solid_angle=0.5)
    write_table(tmp_path / "t.h5", table)
    read = open_table(tmp_path / "t.h5")
    assert read.channels == Channels.grey() and read.receiver_solid_angle == 0.5 and read.u_f is None
    assert hdf5_reading.LAZY_BYTES > block_writer.BLOCK_CELLS


def test_what_is_known_at_the_end_is_written_over_the_room_kept_for_it(tmp_path):
    table, path = random_table(LAYOUTS["half_difference"]), tmp_path / "t.h5"
    with writer(path, table) as blocks:
        assert blocks.provenance == PROVENANCE
        blocks.amend(PROVENANCE | {"worst": 0.125})
        first = table.read_values(*blocks.blocks[3])
        blocks.write(3, first["f"], first["u_f"], first["flag"])
    with writer(path, table, provenance={"created": "later"}) as blocks:
        assert blocks.provenance == PROVENANCE | {"worst": 0.125}
        blocks.amend(PROVENANCE | {"worst": 0.25})
        with pytest.raises(ValueError, match="does not fit"):
            blocks.amend({"long": "x" * 10_000})
        fill(blocks, table)
        blocks.finish()
    read = open_table(path)
    assert read.provenance == PROVENANCE | {"worst": 0.25}
    np.testing.assert_array_equal(read.f, table.f)
