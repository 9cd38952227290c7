"""A campaign in this process: what is done is kept, what is changed is added, what fails is a result."""

import dataclasses
import json

import numpy as np
import pytest

import gonio
from gonio.__main__ import main
from gonio.campaigns.perform import Unfinished, perform
from gonio.campaigns.recipe import read_recipe
from gonio.campaigns.tasks import tasks_of

EXPRESSION = "lambert(rho=0.3) + ggx(alpha=0.2, f0=0.04)"
RECIPE = {
    "name": "two levels of noise",
    "fit": ["lambert"],
    "check": True,
    "fit_options": {"starts": 0},
    "measure": [{"materials": [EXPRESSION], "scans": [{"step": 30}], "photons": [1e4, 1e6], "seeds": "0:2"}],
}


def files(folder):
    """Every result by its name within the folder."""
    folders = ("tables", "fits", "checks", "reduced")
    return {p.relative_to(folder): p.read_bytes() for f in folders for p in sorted((folder / f).iterdir())}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign") / "runs"
    return folder, gonio.campaign(RECIPE, folder, workers=0)


def test_each_task_has_a_file_and_a_row(runs):
    folder, outcome = runs
    assert outcome.tally.done == {"measure": 4, "fit": 4, "check": 4} and not outcome.tally.kept
    catalogue = outcome.to_pandas()
    assert len(catalogue) == 12 and catalogue.key.is_unique and (catalogue.status == "done").all()
    assert all((folder / file).is_file() for file in catalogue.file)
    fits = catalogue[catalogue.kind == "fit"]
    assert (fits["u(lambert.rho)"] > 0).all() and set(fits.photons) == {1e4, 1e6} and set(fits.seed) == {0, 1}
    assert (fits.reduced_chi2 > 1).all() and not fits.good.all() and outcome.exit_status == 1  # there is a lobe


def test_results_are_what_the_verbs_give(runs):
    folder, outcome = runs
    fits = outcome.to_pandas().query("kind == 'fit' and photons == 1e6 and seed == 1")
    layout = gonio.instrument.scans.scan("isotropic", step=np.radians(30))
    table = gonio.measure(EXPRESSION, gonio.Instrument(photons=1e6), layout, seed=1)
    alone = gonio.fit(table, "lambert", starts=0)
    assert fits["lambert.rho"].item() == alone.parameters[0].value
    assert gonio.material(folder / fits.file.item()).expression == alone.expression


def test_a_second_run_does_nothing_and_a_changed_recipe_adds(runs, monkeypatch):
    folder, _ = runs
    before = files(folder)
    with monkeypatch.context() as patch:
        patch.setattr("gonio.campaigns.perform.perform", lambda *_: pytest.fail("it was done again"))
        again = gonio.campaign(RECIPE, folder, workers=0)
    assert again.tally.kept.total() == 12 and not again.tally.done and files(folder) == before
    fewer = RECIPE | {"check": False, "measure": [RECIPE["measure"][0] | {"seeds": [1, 2], "photons": [1e6]}]}
    added = gonio.campaign(fewer, folder, workers=0)
    assert added.tally.kept == {"measure": 1, "fit": 1} and added.tally.done == {"measure": 1, "fit": 1}
    assert before.items() <= files(folder).items()
    catalogue = added.to_pandas()
    assert len(catalogue) == 14 and catalogue.current.sum() == 4


def test_lost_and_broken_files_are_made_again_bit_for_bit(runs):
    folder, _ = runs
    before = files(folder)
    first, second = (folder / "records" / f"{t.key}.json" for t in tasks_of(read_recipe(RECIPE))[1:3])
    first.write_text("{", "utf-8")
    lost = folder / json.loads(second.read_text("utf-8"))["file"]
    lost.unlink()
    (folder / "catalogue.parquet").unlink()
    outcome = gonio.campaign(RECIPE, folder, workers=0)
    assert outcome.tally.done.total() == 2 and files(folder) == before
    assert (folder / "catalogue.parquet").exists()


def test_parts_together_are_the_whole(runs, tmp_path):
    folder, _ = runs
    names = [gonio.campaign(RECIPE, tmp_path, workers=0, part=(k, 3)).tally.done.total() for k in (3, 1, 2)]
    assert sum(names) == 12 and not (tmp_path / "catalogue.parquet").exists()
    assert files(tmp_path).items() <= files(folder).items()
    assert main(["campaign", str(tmp_path), "-q"]) == 0 and (tmp_path / "catalogue.parquet").exists()


def test_what_is_refused_is_a_result_with_its_sentence(tmp_path, capsys):
    (tmp_path / "empty.csv").write_text("theta_i,theta_o,f\n")
    recipe = tmp_path / "r.toml"
    recipe.write_text('gonio_campaign = 1\ntables = ["*.csv"]\nfit = ["lambert", "ggx"]\ncheck = ["fits"]\n')
    words = ["campaign", str(recipe), "-o", str(tmp_path / "runs"), "--workers", "0"]
    assert main(words) == 1
    out = capsys.readouterr().out
    assert "refused: 2 fits, 2 checks" in out and "empty.csv" in out
    assert main(words) == 1 and "done nothing" in capsys.readouterr().out
    assert main([*words, "--retry", "--json"]) == 1
    facts = json.loads(capsys.readouterr().out)
    assert facts["refused"] == {"fit": 2, "check": 2} and facts["verb"] == "campaign" and len(facts["worst"]) == 4


def test_a_fault_is_told_and_tried_again(tmp_path, monkeypatch, capsys):
    recipe = RECIPE | {"measure": [RECIPE["measure"][0] | {"seeds": 5, "photons": 1e5}], "check": False}
    with monkeypatch.context() as patch:
        patch.setattr("gonio.instrument.measurement.measure", lambda *_, **__: 1 / 0)
        outcome = gonio.campaign(recipe, tmp_path, workers=0)
    assert outcome.exit_status == 1 and len(outcome.tally.faults) == 2
    assert "a fault of gonio (ZeroDivisionError" in outcome.worst[0]
    assert gonio.campaign(recipe, tmp_path, workers=0).tally.done == {"measure": 1, "fit": 1}


def test_a_full_disk_ends_in_a_sentence_and_loses_nothing(tmp_path, monkeypatch):
    recipe = RECIPE | {"measure": [RECIPE["measure"][0] | {"photons": 1e6}], "check": False}

    def full(self, kind, key, write):
        if kind == "fit":
            raise gonio.GonioError(f"no room on the disk for {key}; free some, or write to another folder")
        return store_write(self, kind, key, write)

    from gonio.campaigns.store import Store

    store_write = Store.write
    with monkeypatch.context() as patch:
        patch.setattr(Store, "write", full)
        with pytest.raises(gonio.GonioError, match=r"no room on the disk.*run it again to go on"):
            gonio.campaign(recipe, tmp_path, workers=0)
    outcome = gonio.campaign(recipe, tmp_path, workers=0)
    assert outcome.tally.kept == {"measure": 1} and outcome.tally.done == {"measure": 1, "fit": 2}


def test_a_dry_run_counts_and_writes_nothing(tmp_path, capsys):
    recipe = tmp_path / "r.toml"
    recipe.write_text(
        'gonio_campaign = 1\nfit = ["lambert", "auto"]\n[[measure]]\nmaterials = ["gold", "grey_card"]\n'
        'scans = [{scan = "in-plane", theta_i = [30], step = 10}]\nphotons = 1e6\nseeds = "0:50"\n'
    )
    assert main(["campaign", str(recipe), "-o", str(tmp_path / "runs"), "--dry-run", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["tasks"] == {"measure": 100, "fit": 200} and facts["cells"] == 17 * 100
    assert facts["hours"] > 0 and facts["bytes"] >= 17 * 100 * 17 and not (tmp_path / "runs").exists()


def test_workers_that_would_give_something_else_do_nothing(tmp_path):
    (tmp_path / "m.toml").write_text('gonio_material = 1\nname = "m"\nmodel = "lambert(rho=0.3)"\n')
    (task,) = tasks_of(read_recipe({"measure": [{"materials": [str(tmp_path / "m.toml")]}]}))
    with pytest.raises(Unfinished, match="install one version"):
        perform(dataclasses.replace(task, version="0.0"), str(tmp_path))
    with pytest.raises(Unfinished, match="does not see the folder"):
        perform(task, str(tmp_path / "elsewhere"))
    (tmp_path / "m.toml").write_text("changed")
    with pytest.raises(Unfinished, match=r"m\.toml has changed since the campaign began"):
        perform(task, str(tmp_path))
