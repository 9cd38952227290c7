"""The HDF5 file: what is written is what is read, by gonio and by xarray; strangers and full disks."""

import errno
import os
import random
import subprocess
import sys
import textwrap

import h5py
import numpy as np
import pytest
import xarray

from gonio.data import layouts
from gonio.data.channels import Channels
from gonio.data.flags import FLAG_MEANINGS, Flag
from gonio.data.hdf5.writer import BlockWriter, TableHeader, open_table, write_table
from gonio.data.table import Table
from gonio.models.errors import GonioError
from support.tables import LAYOUTS, assert_same, random_table


@pytest.mark.parametrize("u_f", ["exact", "unknown"])
def test_a_constant_uncertainty_takes_no_room(tmp_path, u_f):
    table = random_table(layouts.merl(counts=(20, 20, 20)), np.float32, u_f)
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


@pytest.mark.parametrize("name", ["isotropic", "half_difference", "scattered"])
def test_xarray_opens_it_with_named_axes_units_and_flags(tmp_path, name):
    table = random_table(LAYOUTS[name])
    write_table(tmp_path / "t.h5", table)
    with xarray.open_dataset(tmp_path / "t.h5", engine="h5netcdf") as data:
        assert data.f.dims == (*table.layout.dims, "channel")
        np.testing.assert_array_equal(data.f.values, table.f)
        for axis, values in table.layout.axes.items():
            np.testing.assert_array_equal(data.coords[axis].values, values)
            assert data[axis].attrs["units"] == "radian" and data[axis].attrs["long_name"]
        assert data.f.attrs["units"] == data.u_f.attrs["units"] == "sr-1"
        assert list(data.channel.values) == ["a", "b", "µ"]
        assert list(data.wavelength.values) == [450.0, 550.5, 632.8]
        assert tuple(data.flag.attrs["flag_meanings"].split()) == FLAG_MEANINGS
        assert list(data.flag.attrs["flag_values"]) == [int(v) for v in Flag]


def test_it_can_be_saved_again_by_xarray_and_read(tmp_path):
    table = random_table(LAYOUTS["isotropic"])
    write_table(tmp_path / "t.h5", table)
    with xarray.open_dataset(tmp_path / "t.h5", engine="h5netcdf") as data:
        packed = {name: {"zlib": True, "complevel": 4} for name in ("f", "u_f", "flag")}
        data.to_netcdf(tmp_path / "again.nc", engine="h5netcdf", encoding=packed)
    assert_same(open_table(tmp_path / "again.nc"), table)


def test_what_xarray_reorders_is_read_in_order_or_refused(tmp_path):
    angles = np.linspace(0.1, 1.0, 3)
    grid = layouts.isotropic(angles, angles, angles)
    f = np.random.default_rng(0).random((3, 3, 3, 3))
    table = Table(grid, f, np.zeros(f.shape, np.uint8), Channels(("a", "b", "µ")))
    data = table.to_xarray()
    for n, (turned, said) in enumerate(
        (
            (data.transpose("theta_o", "theta_i", "delta_phi", "channel"), "theta_i as dimension 2, expected 1"),
            (data.transpose("channel", ...), "expected 1"),
            (data.isel(channel=[2, 1, 0]), "channels are µ, b, a by the coordinate"),
        )
    ):
        turned.to_netcdf(tmp_path / f"{n}.h5", engine="h5netcdf")
        with pytest.raises(GonioError, match=said):
            open_table(tmp_path / f"{n}.h5")
        read = Table.from_xarray(turned)
        order = [read.channels.names.index(name) for name in table.channels.names]
        np.testing.assert_array_equal(read.f[..., order], f)


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
    "f is packed": lambda file: file["f"].attrs.__setitem__("scale_factor", 1e-4),
    "writes -999 where it has no value": lambda file: file["u_f"].attrs.__setitem__("_FillValue", -999.0),
    "f has units 'percent'": lambda file: file["f"].attrs.__setitem__("units", "percent"),
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
        BlockWriter(tmp_path / "u.h5", TableHeader(table.layout, table.channels))
    monkeypatch.setattr(os, "fsync", full)  # where delayed allocation fails
    with pytest.raises(GonioError, match="no room on the disk"):
        write_table(tmp_path / "u.h5", table)
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]


FULL = """
    import resource, signal, sys
    import numpy as np
    from gonio.data import layouts
    from gonio.data.channels import Channels
    from gonio.data.hdf5.writer import BlockWriter, TableHeader, write_table
    from gonio.data.table import whole_table_of_values
    from gonio.models.errors import GonioError

    table = whole_table_of_values(layouts.merl(counts=(20, 20, 20)), np.ones((20, 20, 20)))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)  # as a disk that has so much room
    header = TableHeader(table.layout, Channels.grey())
    for write in (lambda: write_table("t.h5", table), lambda: BlockWriter("t.h5", header)):
        try:
            write()
        except GonioError as error:
            print(error)
"""


@pytest.mark.parametrize("room", [0, 100, 5000, 80_000])
def test_a_full_disk_ends_in_one_sentence_and_leaves_nothing(tmp_path, room):
    (tmp_path / "full.py").write_text(textwrap.dedent(FULL))
    command = [sys.executable, "full.py", str(room)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == 2 * ["no room on the disk for t.h5; free some, or write to another folder"]
    assert done.stderr == "" and [p.name for p in tmp_path.iterdir()] == ["full.py"]


def test_a_device_is_no_output(tmp_path):
    with pytest.raises(GonioError, match="is a device"):
        write_table(os.devnull, random_table(LAYOUTS["in_plane"]), force=True)
