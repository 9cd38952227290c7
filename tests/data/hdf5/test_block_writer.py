"""Writing in blocks: interrupted, killed, damaged and taken up again, the file ends the same."""

import random
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from gonio.data.hdf5.schema import cell_locations
from gonio.data.hdf5.writer import BlockWriter, TableHeader, open_table, write_table
from gonio.data.table import Channels, whole_table_of_values
from gonio.models.errors import GonioError
from support.tables import LAYOUTS, PROVENANCE, assert_same, random_table


def writer(path, table, **options):
    options = {"recipe": {"seed": 7}, "block_cells": 11} | options
    provenance = options.pop("provenance", PROVENANCE)
    header = TableHeader(table.layout, table.channels, table.f.dtype, provenance, "a name", source_solid_angle=1e-3)
    return BlockWriter(path, header, **options)


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


def test_a_damaged_part_is_kept_unless_forced_and_a_lost_block_written_again(tmp_path):
    table, path = random_table(LAYOUTS["half_difference"]), tmp_path / "t.h5"
    part = tmp_path / "t.h5.part"
    with writer(path, table) as blocks:
        fill(blocks, table)
        offset = cell_locations(part).offsets["f"]
    with part.open("r+b") as file:
        file.seek(offset + 11 * 3 * 8 * 2 + 5)
        file.write(b"\x55\x55")
    with writer(path, table) as blocks:
        assert blocks.missing_blocks() == [2]
    whole = part.read_bytes()
    for stranger in (b"a", whole[:100], whole[: len(whole) // 2], whole[:-1], b"notes of somebody\n" * 9):
        part.write_bytes(stranger)
        with pytest.raises(GonioError, match=r"t\.h5\.part is no unfinished measurement of gonio; finish or remove it"):
            writer(path, table)
        assert part.read_bytes() == stranger and [p.name for p in tmp_path.iterdir()] == [part.name]
        with writer(path, table, force=True) as blocks:
            assert len(blocks.missing_blocks()) == len(blocks.blocks)
    part.write_bytes(b"")
    with writer(path, table) as blocks:
        assert len(blocks.missing_blocks()) == len(blocks.blocks)
    part.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(GonioError, match="is a link"):
        writer(path, table, force=True)


def test_an_ideal_instruments_uncertainty_is_not_stored(tmp_path):
    table = random_table(LAYOUTS["half_difference"], u_f="exact")
    with writer(tmp_path / "t.h5", table, u_f=False) as blocks:
        fill(blocks, table)
        blocks.finish()
    assert_same(open_table(tmp_path / "t.h5"), table)


KILLED = """
    import sys, time
    import numpy as np
    from gonio.data import layouts
    from gonio.data.hdf5.writer import BlockWriter, TableHeader
    from gonio.data.channels import Channels

    header = TableHeader(layouts.merl(counts=(30, 30, 60)), Channels.rgb())
    with BlockWriter(sys.argv[1], header, recipe={"seed": 1}, block_cells=1800) as blocks:
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
