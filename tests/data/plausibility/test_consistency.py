"""A table that contradicts itself is refused where it is read, in one sentence, by every reader."""

import struct

import h5py
import numpy as np
import pytest

from gonio.data.flags import Flag
from gonio.data.formats.registry import read
from gonio.data.hdf5 import reader
from gonio.data.plausibility.consistency import LARGEST_F
from gonio.models.errors import GonioError
from support.tables import grey_table


def changed(path, **changes):
    """A table's file in which one value of some variables, or a whole attribute, is another."""
    grey_table(u_f=np.full((6, 6, 8, 1), 0.01)).save(path, force=True)
    with h5py.File(path, "r+") as file:
        for name, value in changes.items():
            if name in file.attrs:
                file.attrs[name] = value
            else:
                file[name][(1,) if file[name].ndim == 1 else (0,) * file[name].ndim] = value
    return path


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"f": np.nan}, "flagged valid that is no number"),
        ({"f": -np.inf}, "flagged valid that is no number"),
        ({"f": 10 * LARGEST_F}, "flagged valid that is no number"),
        ({"flag": len(Flag)}, "a flag that is none of 0 valid"),
        ({"flag": 255}, "a flag that is none of 0 valid"),
        ({"u_f": -1e-9}, "negative or infinite u_f"),
        ({"u_f": np.inf}, "negative or infinite u_f"),
        ({"theta_i": np.nan}, "outside 0 to"),
        ({"theta_i": -0.1}, "outside 0 to"),
        ({"theta_i": 0.0}, "not strictly increasing"),
        ({"delta_phi": 7.0}, "outside 0 to"),
        ({"source_solid_angle_sr": -1.0}, "solid angle from 0 to 2π"),
        ({"source_solid_angle_sr": np.nan}, "solid angle from 0 to 2π"),
        ({"channel_names": '["a", "b"]'}, "names 2 channels but holds 1"),
        ({"channel_names": "[" * 400 + "]" * 400}, "longer or deeper"),
        ({"channel_names": "9" * 5000}, "no JSON list"),
        ({"provenance": '{"a": ' * 50 + "1" + "}" * 50}, "longer or deeper"),
    ],
    ids=str,
)
def test_one_wrong_value_is_refused(tmp_path, changes, said):
    if "source_solid_angle_sr" in changes:
        table = grey_table(source_solid_angle=1e-3)
        table.save(tmp_path / "t.h5")
        with h5py.File(tmp_path / "t.h5", "r+") as file:
            file.attrs.update(changes)
    else:
        changed(tmp_path / "t.h5", **changes)
    with pytest.raises(GonioError, match=said) as error:
        read(tmp_path / "t.h5")
    assert str(error.value).startswith(str(tmp_path / "t.h5")) and "\n" not in str(error.value)


def test_a_cell_below_the_horizon_is_no_valid_one_and_its_flag_says_so(tmp_path):
    path = changed(tmp_path / "t.h5")
    with h5py.File(path, "r+") as file:
        file["theta_i"][-1] = np.pi / 2
        file["flag"][-1] = Flag.BELOW_HORIZON
    assert read(path).counts()["below_horizon"] == 6 * 8
    with h5py.File(path, "r+") as file:
        file["flag"][-1, 2] = Flag.VALID
    with pytest.raises(GonioError, match=r"at or below the horizon flagged valid, at θi 90°, .*flag it 1"):
        read(path)


def test_uncertainties_may_be_unknown_or_exact(tmp_path):
    assert np.isnan(read(changed(tmp_path / "t.h5", u_f=np.nan)).u_f).sum() == 1
    assert (read(changed(tmp_path / "t.h5", u_f=0.0)).u_f == 0).sum() == 1


def test_other_formats_are_held_against_the_same_rules(tmp_path):
    path = tmp_path / "m.binary"
    path.write_bytes(struct.pack("<3i", 2, 2, 4) + np.full(48, 1e300).tobytes())
    with pytest.raises(GonioError, match="flagged valid that is no number"):
        read(path)


def test_texts_of_a_stranger_are_printable_and_short(tmp_path):
    names = '["a\\u001b[2J", "\\ud800"]'
    table = grey_table().only(["grey"])
    table.save(tmp_path / "t.h5")
    with h5py.File(tmp_path / "t.h5", "r+") as file:
        file.attrs["title"] = "x\ngonio: verdict pass\x9b\u202e" + "y" * 100_000
        file.attrs["channel_names"] = names.split(", ")[0] + "]"
        file.attrs["provenance"] = '{"source": "\\ud800"}'
    table = read(tmp_path / "t.h5")
    assert table.name.isprintable() and len(table.name) < 300
    assert table.channels.names == ("a\\u001b[2J",) and table.provenance == {"source": "\\ud800"}


@pytest.mark.parametrize("kind", ["soft", "external", "virtual", "outside"])
def test_no_link_leads_out_of_a_file(tmp_path, kind):
    path, other = changed(tmp_path / "t.h5"), changed(tmp_path / "other.h5")
    with h5py.File(path, "r+") as file:
        shape = file["f"].shape
        for name in ("f", "wavelength"):
            if name in file:
                del file[name]
            if kind == "soft":
                file[name] = h5py.SoftLink("/u_f")
            elif kind == "external":
                file[name] = h5py.ExternalLink(str(other), "/f")
            elif kind == "virtual":
                layout = h5py.VirtualLayout(shape, np.float64)
                layout[...] = h5py.VirtualSource(str(other), "f", shape)
                file.create_virtual_dataset(name, layout)
            else:
                file.create_dataset(name, shape, np.float64, external=[(str(other), 2000, h5py.h5f.UNLIMITED)])
    with pytest.raises(GonioError, match="not stored in the file itself"):
        read(path)


@pytest.mark.parametrize(("chunk", "said"), [(1 << 21, "packed in blocks of more than"), (1 << 14, "unpacks to")])
def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch, chunk, said):
    monkeypatch.setattr(reader, "LAZY_BYTES", 1 << 20)
    path, shape = tmp_path / "t.h5", (1 << 21, 1)
    with h5py.File(path, "w") as file:
        file.attrs.update({"gonio_format": np.int32(1), "layout": "scattered", "channel_names": '["grey"]'})
        for name, kind in (("f", "f8"), ("u_f", "f8"), ("flag", "u1")):
            file.create_dataset(name, data=np.zeros(shape, kind), chunks=(chunk, 1), compression="gzip")
    assert path.stat().st_size < 1 << 17
    with pytest.raises(GonioError, match=said):
        read(path)
