"""Outputs that cannot be written: one line, status 2, and everything that was there is there still."""

import os
import subprocess
import sys

import pytest

from gonio.__main__ import main
from support.tables import grey_table

COMMANDS = {".csv": ["convert", "in.h5"], ".h5": ["convert", "in.csv"], ".binary": ["convert", "in.h5"]}
HOSTILE = {
    "a folder": lambda path: path.mkdir(),
    "a pipe": lambda path: os.mkfifo(path),
    "a link to a device": lambda path: path.symlink_to("/dev/full"),
    "a link to an input": lambda path: path.symlink_to(path.with_name("in.h5")),
    "a file": lambda path: path.write_text("kept"),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("in.h5", "in.csv"):
        grey_table().save(tmp_path / name)
    return tmp_path


def state(folder):
    return {
        p.name: p.read_bytes() if p.is_file() and not p.is_symlink() else str(p.lstat().st_mode)
        for p in folder.iterdir()
    }


def refused(command, folder, capsys):
    before = state(folder)
    assert main(command) == 2
    assert state(folder) == before
    error = capsys.readouterr().err
    assert error.startswith("gonio: ") and error.count("\n") == 1 and len(error) < 400
    return error


@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("suffix", COMMANDS)
def test_what_stands_in_the_way_stays(folder, capsys, suffix, kind):
    HOSTILE[kind](folder / f"x{suffix}")
    refused([*COMMANDS[suffix], f"x{suffix}"], folder, capsys)


@pytest.mark.parametrize("name", ["none/x", "x" * 300, "in.csv/x", "a\n\x1b[2J/x"])
@pytest.mark.parametrize("suffix", COMMANDS)
def test_a_name_that_no_file_can_have_is_one_printable_line(folder, capsys, suffix, name):
    assert refused([*COMMANDS[suffix], name + suffix], folder, capsys).strip().isprintable()


def test_the_longest_names_can_be_written(folder):
    for suffix, command in COMMANDS.items():
        name = "x" * (255 - len(suffix)) + suffix
        assert main([*command, name]) == 0 and (folder / name).is_file()


def test_a_strangers_unfinished_file_stays_unless_forced(folder, capsys):
    (folder / "x.h5.part").write_text("somebody's")
    command = ["measure", "lambert(rho=0.5)", "--step", "45", "-o", "x.h5"]
    assert "no unfinished measurement" in refused(command, folder, capsys)
    (folder / "x.h5.part").unlink()
    (folder / "x.h5.part").hardlink_to(folder / "in.h5")
    assert "is an input" in refused(["convert", "in.h5", "x.h5", "--force"], folder, capsys)


@pytest.mark.parametrize("suffix", [".h5", pytest.param(".csv", marks=pytest.mark.thorough)])
def test_a_full_disk_is_one_line(folder, suffix):
    code = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n"
    code += "from gonio.__main__ import command; command()"
    before = state(folder)
    command = [sys.executable, "-c", code, *COMMANDS[suffix], f"x{suffix}"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"GONIO_NO_CACHE": "1"})
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "no room on the disk" in done.stderr, done
    assert state(folder) == before
