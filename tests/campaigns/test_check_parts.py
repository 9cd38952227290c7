"""Large tables checked in parts: the bytes of one check, whatever was lost meanwhile, on any number of processes."""

import math
import pathlib

import numpy as np
import pytest

import gonio
from gonio.campaigns import table_parts
from gonio.campaigns.check_parts import size_of_file
from gonio.campaigns.perform import perform
from gonio.campaigns.recipe import read_recipe
from gonio.campaigns.store import Store
from gonio.campaigns.tasks import tasks_of

MEASURED = {
    "check": True,
    "measure": [{"materials": ["lambert(rho=0.3)"], "scans": [{"step": 15}], "photons": 1e6}],
}


def checks(folder: pathlib.Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in (folder / "checks").iterdir()}


def rows(folder: pathlib.Path) -> list[dict]:
    return [r.row for r in Store(folder).records()]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A table's file."""
    path = tmp_path_factory.mktemp("file") / "t.h5"
    scan = gonio.scan("isotropic", step=math.radians(15))
    gonio.measure("grey_card", gonio.Instrument(photons=1e5), scan).save(path)
    return path


def recipe_of(name, file):
    return MEASURED if name == "measured" else {"check": True, "tables": [str(file)]}


@pytest.mark.parametrize("name", ["measured", "file"])
def test_a_check_of_parts_is_one_check_bit_for_bit(tmp_path, monkeypatch, name, file):
    recipe = recipe_of(name, file)
    gonio.campaign(recipe, tmp_path / "whole", workers=0)
    monkeypatch.setattr(table_parts, "PART_VALUES", 150)
    outcome = gonio.campaign(recipe, tmp_path / "parts", workers=0)
    assert outcome.tally.done["part"] > 4 and outcome.tally.done["check"] == 1
    assert checks(tmp_path / "parts") == checks(tmp_path / "whole")
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole")  # and no record of a part remains
    assert not (tmp_path / "parts" / "parts").exists()
    again = gonio.campaign(recipe, tmp_path / "parts", workers=0)
    assert again.tally.kept["check"] == 1 and not again.tally.done


def test_parts_that_are_there_are_kept_and_lost_ones_done_anew(tmp_path, monkeypatch, file):
    recipe = recipe_of("file", file)
    gonio.campaign(recipe, tmp_path / "whole", workers=0)
    monkeypatch.setattr(table_parts, "PART_VALUES", 150)
    tasks = tasks_of(read_recipe(recipe))
    store = Store(tmp_path / "parts")
    store.prepare()
    for task in tasks[1:4]:
        perform(task, str(store.folder))
    store.path("part", tasks[2].key).unlink()
    outcome = gonio.campaign(recipe, store.folder, workers=0)
    assert outcome.tally.kept == {"part": 2} and outcome.tally.done == {"part": len(tasks) - 3, "check": 1}
    assert checks(store.folder) == checks(tmp_path / "whole")


def test_a_file_that_changes_meanwhile_is_refused_by_every_part(tmp_path, monkeypatch):
    table = gonio.measure("lambert(rho=0.3)", scan=gonio.scan("isotropic", step=math.radians(15)))
    table.save(tmp_path / "t.h5")
    monkeypatch.setattr(table_parts, "PART_VALUES", 150)
    tasks = tasks_of(read_recipe(recipe_of("file", tmp_path / "t.h5")))
    store = Store(tmp_path / "runs")
    store.prepare()
    perform(tasks[0], str(store.folder))
    table.f = np.asarray(table.f) * 2
    table.save(tmp_path / "t.h5", force=True)
    for task in tasks[1:]:
        with pytest.raises(gonio.GonioError, match=r"has changed since the campaign began"):
            perform(task, str(store.folder))


def test_no_other_file_is_divided(tmp_path, file):
    assert size_of_file(str(file)) is None  # of few bytes
    (tmp_path / "t.csv").write_text("theta_i,phi_i,theta_o,phi_o,f\n" + "0,0,10,0,1\n" * 500_000)
    assert size_of_file(str(tmp_path / "t.csv")) is None and size_of_file(str(tmp_path / "none.h5")) is None


def test_a_killed_worker_of_a_cluster_loses_nothing(tmp_path, monkeypatch, file):
    pytest.importorskip("distributed")
    psutil = pytest.importorskip("psutil")
    recipe = recipe_of("file", file)
    gonio.campaign(recipe, tmp_path / "whole", workers=0)
    monkeypatch.setattr(table_parts, "PART_VALUES", 150)
    killed = []

    def kill_one(task, record, done, count):
        if not killed and task.kind == "part":
            processes = psutil.Process().children(recursive=True)
            workers = [p for p in processes if "multiprocessing.spawn" in " ".join(p.cmdline())]
            workers[0].kill()
            killed.append(task.key)

    outcome = gonio.campaign(recipe, tmp_path / "parts", workers=2, over=kill_one)
    assert len(killed) == 1 and outcome.tally.done["check"] == 1 and not outcome.tally.faults
    assert checks(tmp_path / "parts") == checks(tmp_path / "whole")
