"""`gonio fit` of many files: one result each as it finishes, taken up again where it stopped, refusals by name."""

import os
import signal
import subprocess
import sys
import time
import tomllib

import pytest

from gonio.__main__ import main
from gonio.data.hdf5.writer import write_table
from support.tables import grey_table


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    for k in range(3):
        write_table(tmp_path / "in" / f"t{k}.h5", grey_table(rho=0.1 * (k + 1)))
    (tmp_path / "in" / "notes.txt").write_text("not a table\n")
    return tmp_path


COMMAND = ["fit", "in", "-m", "lambert", "-o", "out"]


def test_a_folder_is_fitted_and_taken_up_again(folder, capsys):
    assert main(COMMAND) == 0
    out = capsys.readouterr().out
    assert "3 tables, 1 other files passed over" in out and out.count("converged") == 3 and "[3/3]" in out
    results = {p.name: p.stat().st_mtime_ns for p in (folder / "out").iterdir()}
    assert set(results) == {"t0.fit.toml", "t1.fit.toml", "t2.fit.toml"}
    for k in range(3):
        result = tomllib.loads((folder / "out" / f"t{k}.fit.toml").read_text())
        assert result["fit"]["parameters"][0]["value"] == pytest.approx(0.1 * (k + 1), rel=1e-9)
    (folder / "out" / "t1.fit.toml").unlink()
    assert main(COMMAND) == 0
    out = capsys.readouterr().out
    assert "2 of them were fitted before" in out and "[3/3] t1.h5" in out
    after = {p.name: p.stat().st_mtime_ns for p in (folder / "out").iterdir()}
    assert after.keys() == results.keys() and all(after[n] == results[n] for n in ("t0.fit.toml", "t2.fit.toml"))


def test_another_command_does_not_pass_for_the_same(folder, capsys):
    assert main(COMMAND) == 0
    assert main([*COMMAND, "--loss", "log1p"]) == 2
    assert "another command" in capsys.readouterr().err
    assert main([*COMMAND, "--loss", "log1p", "--force"]) == 0
    assert tomllib.loads((folder / "out" / "t0.fit.toml").read_text())["fit"]["loss"] == "log1p"


def test_a_file_that_cannot_be_fitted_costs_no_other(folder, capsys):
    (folder / "in" / "broken.h5").write_bytes(b"\x89HDF\r\n\x1a\n and nothing more")
    assert main(COMMAND) == 2
    out = capsys.readouterr().out
    assert "broken.h5: refused: " in out and out.count("converged") == 3
    assert len(list((folder / "out").iterdir())) == 3


@pytest.mark.thorough
def test_a_killed_batch_leaves_whole_results(folder):
    for k in range(3, 40):
        (folder / "in" / f"t{k}.h5").write_bytes((folder / "in" / "t0.h5").read_bytes())
    child = subprocess.Popen([sys.executable, "-m", "gonio", *COMMAND], stdout=subprocess.DEVNULL)
    try:
        limit = time.monotonic() + 60
        while not list(folder.glob("out/*.fit.toml")) and child.poll() is None and time.monotonic() < limit:
            time.sleep(0.005)
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    there = {p: p.stat().st_mtime_ns for p in folder.glob("out/*.fit.toml")}
    assert there and all("recipe" in tomllib.loads(p.read_text()) for p in there)
    assert main(COMMAND) == 0
    assert len(list(folder.glob("out/*.fit.toml"))) == 40
    assert all(p.stat().st_mtime_ns == then for p, then in there.items())


@pytest.mark.parametrize(
    ("name", "told"),
    [("lambert + ggx(f0=?)", "is a model, not a file; give models by -m"), ("t9.h5", "does not exist")],
)
def test_what_is_no_file_is_told_before_any_work(folder, name, told, capsys):
    assert main(["fit", "in/t0.h5", name, "-o", "out"]) == 2
    assert told in capsys.readouterr().err and not (folder / "out").exists()
