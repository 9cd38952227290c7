"""Large tables measured in parts: the bytes of one measurement, whatever was lost meanwhile."""

import itertools
import math
import pathlib

import pytest

import gonio
from gonio.campaigns import table_parts
from gonio.campaigns.perform import perform
from gonio.campaigns.recipe import read_recipe
from gonio.campaigns.store import Store
from gonio.campaigns.tasks import tasks_of

DIRECTIONS = "theta_i,phi_i,theta_o,phi_o,seconds\n" + "".join(f"{t},0,{t / 2},180,{1 + t / 50}\n" for t in range(80))
RECIPES = {
    "exact": {"materials": ["lambert(rho=[0.3, 0.2])"], "scans": [{"step": 30}]},
    "noise": {"materials": ["lambert(rho=0.3)"], "scans": [{"step": 30}], "instruments": [{"noise": 0.01}], "seeds": 3},
    "apertures": {
        "materials": ["grey_card"], "scans": [{"step": 30}],
        "instruments": [{"detector_half_angle": 0.5, "source_half_angle": 0.25}],
    },
    "file": {"materials": ["lambert(rho=0.3)"], "scans": ["d.csv"], "instruments": [{"noise": 0.01}]},
}  # fmt: skip


def recipe_of(name, folder):
    (folder / "d.csv").write_text(DIRECTIONS)
    block = dict(RECIPES[name])
    if name == "file":
        block["scans"] = [str(folder / "d.csv")]
    return {"measure": [block]}


def tables(folder: pathlib.Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in (folder / "tables").iterdir()}


@pytest.mark.parametrize("name", RECIPES)
def test_a_table_of_parts_is_that_of_one_measurement_bit_for_bit(tmp_path, monkeypatch, name):
    recipe = recipe_of(name, tmp_path)
    gonio.campaign(recipe, tmp_path / "whole", workers=0)
    monkeypatch.setattr(table_parts, "PART_VALUES", 20)
    outcome = gonio.campaign(recipe, tmp_path / "parts", workers=0)
    assert outcome.tally.done["part"] > 2 and outcome.tally.done["measure"] == 1
    assert tables(tmp_path / "parts") == tables(tmp_path / "whole")
    whole, parts = (Store(tmp_path / folder) for folder in ("whole", "parts"))
    assert [r.row for r in parts.records()] == [r.row for r in whole.records()]  # and no record of a part remains
    assert not (tmp_path / "parts" / "parts").exists()
    again = gonio.campaign(recipe, tmp_path / "parts", workers=0)
    assert again.tally.kept == {"measure": 1} and not again.tally.done


def test_parts_that_are_there_are_kept_and_lost_ones_measured_anew(tmp_path, monkeypatch):
    recipe = recipe_of("noise", tmp_path)
    gonio.campaign(recipe, tmp_path / "whole", workers=0)
    monkeypatch.setattr(table_parts, "PART_VALUES", 20)
    tasks = tasks_of(read_recipe(recipe))
    store = Store(tmp_path / "parts")
    store.prepare()
    for task in tasks[:3]:
        perform(task, str(store.folder))
    store.path("part", tasks[1].key).unlink()
    outcome = gonio.campaign(recipe, store.folder, workers=0)
    assert outcome.tally.kept == {"part": 2} and outcome.tally.done == {"part": len(tasks) - 3, "measure": 1}
    assert tables(store.folder) == tables(tmp_path / "whole")


def test_a_part_that_goes_while_the_table_is_put_together_ends_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(table_parts, "PART_VALUES", 20)

    def without_a_part(inputs, store):
        store.path("part", inputs["parts"][1]).unlink()
        return table_parts_assembled(inputs, store)

    table_parts_assembled = table_parts.assembled
    with monkeypatch.context() as patch:
        patch.setattr(table_parts, "assembled", without_a_part)
        with pytest.raises(gonio.GonioError, match=r"a part of a table is gone from .* run it again to go on"):
            gonio.campaign(recipe_of("exact", tmp_path), tmp_path / "runs", workers=0)
    outcome = gonio.campaign(recipe_of("exact", tmp_path), tmp_path / "runs", workers=0)
    assert outcome.tally.done == {"part": 1, "measure": 1} and outcome.exit_status == 0


def test_parts_are_whole_rows_that_cover_a_large_table_once():
    small = gonio.scan("isotropic")
    assert table_parts.part_ranges(small, 3) == [(0, small.size)]
    large = gonio.scan("isotropic", step=math.radians(0.5))
    ranges = table_parts.part_ranges(large, 3)
    assert len(ranges) > 2 and ranges[0][0] == 0 and ranges[-1][1] == large.size
    assert all(a[1] == b[0] and b[0] % large.row_size == 0 for a, b in itertools.pairwise(ranges))
    assert all((stop - start) * 3 <= table_parts.PART_VALUES for start, stop in ranges)
