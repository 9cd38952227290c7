"""Files are known by their content, whatever their name."""

import os
import struct
import time

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.formats.registry import read, sniff
from gonio.data.hdf5.writer import write_table
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from support import helpers
from support.marks import thorough

CONTENTS = {
    "CSV": b"# a comment\ntheta_i,phi_i,theta_o,phi_o,f\n10,0,20,0,0.3\n",
    "NIST": b"lambda,thetai,phi,thetar,phir,f_r11\n0.633,-30,0,30,0,0.3\n",
    "MERL": struct.pack("<3i", 2, 2, 4) + np.ones(48).tobytes(),
}


@pytest.mark.parametrize("kind", CONTENTS)
def test_a_file_is_known_by_its_content(tmp_path, kind):
    (tmp_path / "t.dat").write_bytes(CONTENTS[kind])
    assert sniff(tmp_path / "t.dat").name == kind
    assert read(tmp_path / "t.dat").provenance["format"].startswith(kind)


def test_a_table_of_our_own_and_a_material_of_rgl(tmp_path):
    grid = layouts.in_plane([0.1], [0.2, 0.3])
    write_table(tmp_path / "t.dat", whole_table_of_values(grid, np.ones(grid.shape)))
    assert sniff(tmp_path / "t.dat").name == "HDF5" and read(tmp_path / "t.dat").layout == grid
    path = helpers.shared("data", "rgl", "cardboard_rgb.bsdf")
    assert sniff(path).name == "RGL" and "cardboard" in read(path).provenance["material"]


def test_options_go_to_the_format_that_has_them(tmp_path):
    for kind, options in (("MERL", {"nodes": "centre"}), ("NIST", {"wavelength_nm": 633})):
        (tmp_path / "t.dat").write_bytes(CONTENTS[kind])
        assert read(tmp_path / "t.dat", **options).layout.size > 0
    (tmp_path / "t.dat").write_bytes(CONTENTS["CSV"])
    with pytest.raises(GonioError, match="no option 'nodes'"):
        read(tmp_path / "t.dat", nodes="centre")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"\0\1\2\3\4\0\0\0", "binary of an unknown kind"),
        (b"PK\3\4\0\0\0\0", "a ZIP archive, which gonio does not read"),
        (struct.pack("<3i", 90, 90, 180) + bytes(80), "does not fit its 92 bytes"),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), "not a whole HDF5 file"),
        (b"tensor_file\0\1", "ends inside its header"),
        (b"hello world\n", "text of an unknown kind"),
        (b"0.1,0.2,0.3\n", "has no header"),
        (b"theta_i,theta_o,f\n1,2,3\n", "no azimuth"),
        (b"caf\xe9\n", "text of an unknown kind"),
    ],
)
def test_an_unknown_or_damaged_file_is_refused_in_one_sentence(tmp_path, content, said):
    (tmp_path / "t.dat").write_bytes(content)
    with pytest.raises(GonioError, match=said) as error:
        read(tmp_path / "t.dat")
    assert "t.dat" in str(error.value) and "\n" not in str(error.value)


def test_paths_that_are_no_files(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path / "fifo", "/dev/zero"):
        with pytest.raises(GonioError, match="is a pipe, socket or device"):
            sniff(path)
    with pytest.raises(GonioError, match="null character"):
        sniff("a\0b.csv")
    with pytest.raises(GonioError, match="is a folder"):
        sniff(tmp_path)
    with pytest.raises(GonioError, match="does not exist"):
        sniff(tmp_path / "none")


@pytest.mark.parametrize(
    "word",
    [
        "#",
        "ScatterType",
        "format scale",
        *thorough("VARS", "# format:", "SampleRotation", "type", "AOI", "Source", '{"schema"', "VERSION"),
    ],
)
def test_a_file_of_blanks_is_refused_at_once(tmp_path, word):
    """What a beginning is searched for must not go over the blanks of a stranger's file again from each of them."""
    for text in (word + " " * 60_000 + "x", word + "\n" * 60_000 + "x", f"{word}  " * 8_000, word + " =" * 30_000):
        (tmp_path / "t.txt").write_text(text)
        began = time.process_time()
        with pytest.raises(GonioError):
            sniff(tmp_path / "t.txt")
        assert time.process_time() - began < 2


@pytest.mark.parametrize("subject", ["lambert(rho=0.2)", "gold"])
def test_what_is_no_file_is_told_who_opens_it(subject):
    with pytest.raises(GonioError, match=r"is no file; gonio\.material"):
        read(subject)
