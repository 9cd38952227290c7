"""Texts of variable length: whole ones are read from files of every version, and one that lies is never believed."""

import h5py
import numpy as np
import pytest

from gonio.data import layouts
from gonio.data.hdf5.reader import open_table
from gonio.data.hdf5.writer import write_table
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError

GIBIBYTES = (0xFFFFFFF0).to_bytes(4, "little")


@pytest.fixture(scope="module", params=["earliest", "latest", "behind other bytes"])
def stored(request, tmp_path_factory):
    """A table as gonio writes it, and as a stranger may have written it again."""
    folder, kind = tmp_path_factory.mktemp("texts"), request.param
    table = whole_table_of_values(layouts.in_plane([0.1], [0.2, 0.3]), np.ones((1, 2)))
    write_table(folder / "own.h5", table)
    if kind == "earliest":
        return folder / "own.h5"
    how = {"libver": "latest"} if kind == "latest" else {"userblock_size": 1024}
    with h5py.File(folder / "own.h5") as own, h5py.File(folder / "other.h5", "w", **how) as other:
        other.attrs.update(own.attrs)
        for name in own:
            other.create_dataset(name, data=own[name][...]).attrs["units"] = own[name].attrs.get("units", "")
    return folder / "other.h5"


def references(whole):
    """Where lengths of texts stand: before each address of the collection that holds them."""
    base = whole.find(b"\x89HDF")
    address = (whole.find(b"GCOL\x01") - base).to_bytes(8, "little")
    starts = [k for k in range(len(whole) - 16) if whole[k : k + 8] == address]
    return [k - 4 for k in starts if 0 < int.from_bytes(whole[k + 8 : k + 12], "little") < 40]


def test_whole_texts_are_read(stored):
    assert open_table(stored).f[0, 0, 0] == 1


@pytest.mark.parametrize("what", ["length", "length and address", "index"])
def test_a_text_that_is_not_as_long_as_it_claims_is_refused(stored, tmp_path, what):
    whole, path, refused = stored.read_bytes(), tmp_path / "t.h5", 0
    for at in references(whole):
        damaged = bytearray(whole)
        if "length" in what:
            damaged[at : at + 4] = GIBIBYTES
        if "address" in what:
            damaged[at + 4 : at + 6] = b"\xff\xff"
        if what == "index":
            damaged[at + 12 : at + 16] = b"\x77\x77\0\0"
        path.write_bytes(damaged)
        try:
            open_table(path)  # an attribute that is not read
        except GonioError as error:
            # The library finds damage itself where the file's version has check sums.
            assert "does not hold the text that it claims" in str(error) or "checksum" in str(error)
            refused += 1
    assert refused >= 4
