"""A campaign on processes of this machine: the same bits, whoever is killed."""

import pathlib
import signal
import subprocess
import sys
import time

import pytest

import gonio
from support.process import gonio as program

pytest.importorskip("distributed")

RECIPE = """gonio_campaign = 1
fit = ["lambert"]
fit_options = {starts = 0}
[[measure]]
materials = ["lambert(rho=0.3)"]
scans = [{step = 45}]
photons = 1e6
seeds = "0:6"
"""


def results(folder: pathlib.Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for f in ("tables", "fits") for p in (folder / f).glob("[!.]*")}


def begin(folder: pathlib.Path, *words: str, recipe: str = RECIPE) -> subprocess.Popen:
    (folder / "r.toml").write_text(recipe)
    command = [*program(), "campaign", "r.toml", "-o", "runs", *words]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_results(folder: pathlib.Path, count: int) -> None:
    ends = time.monotonic() + 120
    while len(list((folder / "runs" / "records").glob("[!.]*.json"))) < count and time.monotonic() < ends:
        time.sleep(0.02)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The results of an undisturbed campaign in one process."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "r.toml").write_text(RECIPE)
    gonio.campaign(folder / "r.toml", folder / "runs", workers=0)
    return results(folder / "runs")


def test_a_killed_scheduler_loses_nothing_and_the_same_command_goes_on(tmp_path, whole):
    child = begin(tmp_path, "--workers", "1")
    wait_for_results(tmp_path, 2)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    kept = results(tmp_path / "runs")
    again = gonio.campaign(tmp_path / "r.toml", tmp_path / "runs", workers=0)  # and other workers give the same
    assert again.exit_status == 0 and again.tally.kept.total() >= 2
    assert results(tmp_path / "runs") == whole and kept.items() <= whole.items()


def test_an_interrupted_campaign_says_that_it_goes_on(tmp_path):
    # Without noise: nothing of it is compiled.
    child = begin(tmp_path, "--workers", "0", recipe=RECIPE.replace("photons = 1e6\n", ""))
    wait_for_results(tmp_path, 1)
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=120)
    if child.returncode != 0:  # it had not ended before
        assert child.returncode == 130 and "results are kept in runs: run it again to go on" in err


def test_an_address_where_nobody_answers_is_refused_in_a_sentence(tmp_path, monkeypatch):
    (tmp_path / "r.toml").write_text(RECIPE)
    with pytest.raises(gonio.GonioError, match="no scheduler answers"):
        gonio.campaign(tmp_path / "r.toml", tmp_path / "runs", scheduler="nonsense://x")
    with pytest.raises(gonio.GonioError, match="workers are those of the scheduler"):
        gonio.campaign(tmp_path / "r.toml", tmp_path / "runs", scheduler="tcp://127.0.0.1:9", workers=2)


def test_without_dask_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "r.toml").write_text(RECIPE)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(gonio.GonioError, match=r"needs Dask; install it by pip install 'gonio\[campaign\]'"):
        gonio.campaign(tmp_path / "r.toml", tmp_path / "runs", workers=1)
