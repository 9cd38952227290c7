"""Files that are no table yet, and damage that the HDF5 library itself does not survive."""

import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.flags import Flag
from gonio.data.hdf5.writer import BlockWriter, TableHeader, open_table, write_table
from gonio.data.table import Channels, whole_table_of_values
from gonio.models.errors import GonioError


def test_an_unfinished_part_is_refused_and_says_how_far_it_is(tmp_path):
    grid, part = layouts.merl(counts=(4, 5, 6)), tmp_path / "t.h5.part"
    with BlockWriter(tmp_path / "t.h5", TableHeader(grid, Channels.grey()), block_cells=30, u_f=False) as blocks:
        for k in blocks.missing_blocks():
            with pytest.raises(GonioError, match=f"unfinished measurement \\({k} of 4 blocks\\)"):
                open_table(part)
            below = ~grid.readable(30 * k, 30 * (k + 1))
            blocks.write(k, np.full((30, 1), k), None, np.where(below, Flag.BELOW_HORIZON, Flag.VALID))
        tail = part.read_bytes()[-200:]
        blocks.finish()
    assert open_table(tmp_path / "t.h5").f[3, 0, 0, 0] == 3
    # Killed between the renaming and the cutting of the tail, the file is whole.
    with (tmp_path / "t.h5").open("ab") as file:
        file.write(tail[-4 * 8 - 48 :])
    assert open_table(tmp_path / "t.h5").f[3, 0, 0, 0] == 3


def test_a_text_of_a_damaged_type_is_refused_before_the_library_crashes_on_it(tmp_path):
    write_table(tmp_path / "t.h5", whole_table_of_values(layouts.in_plane([0.1], [0.2, 0.3]), np.ones((1, 2))))
    whole = bytearray((tmp_path / "t.h5").read_bytes())
    at = whole.find(b"units\0\0\0") + 8
    assert whole[at : at + 2] == b"\x19\x01"  # a text of variable length; the next byte says so
    whole[at + 1] = 0x9F
    (tmp_path / "t.h5").write_bytes(whole)
    with pytest.raises(GonioError, match="attribute units is neither a text nor a number"):
        open_table(tmp_path / "t.h5")


def test_a_damaged_value_of_all_cells_is_refused_before_the_library_crashes_on_it(tmp_path):
    write_table(tmp_path / "t.h5", whole_table_of_values(layouts.in_plane([0.1], [0.2, 0.3]), np.ones((1, 2))))
    whole = bytearray((tmp_path / "t.h5").read_bytes())
    at = whole.rfind(b"\x05\0\x10\0\x01\0\0\0\x02\x02\x02\x01\x08\0\0\0")
    assert at > 0  # the message of the fill value: its version, when it is written, that there is one, its size
    whole[at + 8 : at + 16] = bytes((160, 200, 235, 133, 243, 204, 225, 127))
    (tmp_path / "t.h5").write_bytes(whole)
    with pytest.raises(GonioError, match="damaged table"):
        open_table(tmp_path / "t.h5")
