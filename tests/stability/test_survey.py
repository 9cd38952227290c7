"""The stability atlas as a whole: its command line, its files and its processes."""

import csv
import signal
import subprocess
import sys

import numpy as np
import pytest

from gonio.__main__ import main
from gonio.stability.fits import fit_cells, readings
from gonio.stability.outcome import METHODS, RIGHT


def test_a_fit_of_a_model_to_itself():
    assert {c.verdict for c in fit_cells("lambert")} == {RIGHT}
    table = readings("lambert(rho=0.5)", 60, 0.01)
    assert table.layout.size == 60 and np.all(table.u_f > 0)


def test_the_command_line(tmp_path, capsys):
    folder = tmp_path / "atlas"
    assert main(["stress", "lambert", "-o", str(folder), "--quick", "--processes", "1"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[-1] == "0 silent failures"
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "0 silent failures" in page and page.count("<svg") == len(METHODS)
    rows = list(csv.DictReader((folder / "stress.csv").read_text(encoding="utf-8").splitlines()))
    assert {r["method"] for r in rows} == set(METHODS) and {r["verdict"] for r in rows} == {RIGHT}
    key = rows[0]["recipe"].split("'")[1]
    assert main(["stress", "lambert", "--quick", "--cell", key]) == 0
    assert capsys.readouterr().out.startswith("right: ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lambret"], "Unknown model 'lambret'; did you mean 'lambert'?"),
        (["lambert", "--cell", "nonsense"], "is no cell"),
        (["--cell", "value/x/y/z"], "name that model"),
        (["lambert", "--processes", "0"], "give 1 or more"),
    ],
)
def test_bad_words_are_refused(words, said, capsys):
    assert main(["stress", *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


@pytest.mark.parametrize("name", ["index.html", "stress.csv", "fit.svg"])
def test_a_finished_atlas_is_not_replaced(name, tmp_path, capsys):
    (tmp_path / name).write_text("kept")
    assert main(["stress", "lambert", "-o", str(tmp_path)]) == 2
    assert "holds an atlas already" in capsys.readouterr().err
    assert (tmp_path / name).read_text() == "kept"


ORPHAN = """
import multiprocessing, os, signal, time
from gonio.stability.run import start_worker

if __name__ == "__main__":
    pool = multiprocessing.get_context("spawn").Pool(1, start_worker)
    print(pool.apply(os.getpid), flush=True)
    pool.apply_async(time.sleep, (300,))
    time.sleep(0.2)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal there")
def test_a_killed_atlas_leaves_no_process(tmp_path):
    (tmp_path / "orphan.py").write_text(ORPHAN)
    # What is left of the pool holds the pipe: its output ends when the last process does, or not in time.
    done = subprocess.run([sys.executable, str(tmp_path / "orphan.py")], capture_output=True, timeout=100)
    assert done.returncode == -signal.SIGKILL and int(done.stdout) > 0
